#!/bin/sh
# ./install.sh           puts haptix into the menu of programs, where this folder lies
# ./install.sh remove    takes it out, and removes the service at log-in, what haptix wrote for itself, and this
#                        folder; layouts, profiles and results stay
set -eu
here=$(cd "$(dirname "$0")" && pwd)
entry="${XDG_DATA_HOME:-$HOME/.local/share}/applications/haptix.desktop"
if [ "${1:-}" = remove ]; then
    "$here/haptix" service remove
    "$here/haptix" cache --clear
    rm -f "$entry"
    rm -rf "$here/_internal" "$here/haptix" "$here/install.sh"
    rmdir "$here"
    exit
fi
mkdir -p "$(dirname "$entry")"
cat > "$entry" << END
[Desktop Entry]
Type=Application
Name=haptix
Comment=Feel textures on an electrovibration touchscreen; STOP
Exec="$here/haptix"
Icon=$here/_internal/haptix.png
Categories=Utility;
END
echo "haptix is in the menu of programs: $entry"
