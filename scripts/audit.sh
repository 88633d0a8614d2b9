#!/usr/bin/env bash
# Which packages this environment has, with their versions and licences (SBOM, CycloneDX), and which
# of them have known faults (pip-audit).
#   bash scripts/audit.sh [FILE]    writes the SBOM to FILE, dist/haptix.cdx.json by default
# The tools go to an environment of their own. Where the registry, or the list of faults, cannot be
# reached, it says so and goes on: that is no fault of ours. A known fault, or no SBOM, is a failure.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
python=${PYTHON:-.venv/bin/python}
sbom=${1:-dist/haptix.cdx.json}
tools=$(mktemp -d)
trap 'rm -rf "$tools"' EXIT

"$python" -m venv "$tools/env"
if ! "$tools/env/bin/python" -m pip install -q pip-audit cyclonedx-bom 2> "$tools/why"; then
    tail -1 "$tools/why" >&2
    echo "skipped: the registry has no pip-audit or cyclonedx-bom for this machine"
    [ "${AUDIT_NEEDED:-}" != 1 ]
    exit
fi

mkdir -p "$(dirname "$sbom")"
"$tools/env/bin/cyclonedx-py" environment --pyproject pyproject.toml --output-reproducible \
    --of JSON -o "$sbom" "$python"
count=$("$python" -c 'import json, sys; print(len(json.load(open(sys.argv[1]))["components"]))' "$sbom")
echo "$sbom: $count packages"

# Exactly what is installed, haptix itself left out.
"$python" -m pip freeze --exclude-editable --exclude haptix-electrovibration > "$tools/installed"
status=0
timeout 300 "$tools/env/bin/pip-audit" --no-deps --disable-pip -r "$tools/installed" \
    > "$tools/found" 2> "$tools/why" || status=$?
cat "$tools/found"
count=$(wc -l < "$tools/installed")
if [ "$status" -eq 124 ] || [ "$(grep -c "could not be audited" "$tools/found")" -ge "$count" ] \
    || grep -qE "ConnectionError|ServiceError|Max retries|ConnectTimeout" "$tools/why"; then
    echo "skipped: the list of known faults cannot be reached"
    [ "${AUDIT_NEEDED:-}" != 1 ]
    exit
fi
tail -5 "$tools/why" >&2
exit "$status"
