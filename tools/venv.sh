# Sourced by ./run, ./test and .ci/run: make .venv and keep it up to date.

# ensure_venv FOLDER EXTRAS: install the project with its extras, unless that was done for
# just these pins before. A stamp is left per set of extras. What the daemon runs with must have
# the hashes of requirements.txt, and for the extra `daemon` nothing else is fetched; what only
# training and tests need is pinned by version alone, since torch has many builds.
ensure_venv() {
    local here=$1 extras=$2 python=${PYTHON:-python3} stamp pins
    if ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
        echo "Python 3.11 or newer is needed; set PYTHON to it" >&2
        return 1
    fi
    pins=$(cat "$here/pyproject.toml" "$here/constraints.txt" "$here/requirements.txt" | cksum | tr ' ' -)
    stamp="$here/.venv/installed-${extras//,/-}-$pins"
    # Another pip install may have put a copy in place of this checkout: edits would do nothing.
    [ -e "$stamp" ] && compgen -G "$here/.venv/lib/*/site-packages/__editable__*" >/dev/null &&
        return 0
    [ -x "$here/.venv/bin/python" ] || "$python" -m venv "$here/.venv"
    echo "installing into .venv (once) ..." >&2
    # --no-compile: what is imported is compiled then, which takes a tenth of compiling all of it.
    "$here/.venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile \
        --require-hashes --requirement "$here/requirements.txt" >&2
    [ "$extras" = daemon ] && set -- --no-index || set --
    "$here/.venv/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile "$@" \
        --no-build-isolation --constraint "$here/constraints.txt" \
        --editable "$here[$extras]" >&2
    : >"$stamp"
}
