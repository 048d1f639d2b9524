"""Model bundles: NAME.onnx, NAME.json (sidecar) and NAME.md (card) each."""
