"""Four-legged animals: gaits, going, staying, playing, jumping; drawn footfalls."""
