#!/usr/bin/env bash
# Make a folder that runs fleetsight on a Linux with a shell, whatever Python and C library are there, as an archive:
#
#   deploy/bundle.sh [EXTRAS [FOLDER]]
#
# makes FOLDER/fleetsight-gateway-VERSION-ARCHITECTURE.tar.gz, in dist unless said. EXTRAS: pki, or such as
# pki,distance,cloud. In it are Debian 12's Python, the shared libraries that it and the wheels need, Debian's C library
# among them, and fleetsight with all that it imports. Needs a machine of the architecture that the bundle is for,
# mmdebstrap and debian-archive-keyring, and a Python with pip and hatchling: the checkout's .venv, or $PYTHON. Needs no
# root.
set -euo pipefail
umask 022
source=$(cd "$(dirname "$0")/.." && pwd)
extras=${1:-pki}
target=$(mkdir -p "${2:-$source/dist}" && cd "${2:-$source/dist}" && pwd)
python=${PYTHON:-$source/.venv/bin/python}
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
packages=$work/packages home=$work/fleetsight
site=$home/lib/python3/dist-packages

say() { printf '[bundle] %s\n' "$*"; }
fail() { printf '[bundle] %s\n' "$*" >&2; exit 1; }

[[ $extras =~ ^[a-z-]+(,[a-z-]+)*$ ]] || fail "extras $extras: expected names such as pki,distance,cloud"
command -v mmdebstrap >/dev/null || fail "mmdebstrap is missing; apt-get install mmdebstrap"
"$python" -c 'import hatchling, pip' 2>/dev/null || fail "$python has no pip or no hatchling: run make .venv/.dist, or set PYTHON"
stamp=$(git -C "$source" log -1 --format=%ct 2>/dev/null || echo 0)

say "Debian's packages"
mkdir -p "$packages" "$home"/{bin,lib,deploy,licences} "$site"
unpack="for each in \"\$1\"/var/cache/apt/archives/*.deb; do
    into=$packages/\$(dpkg-deb --field \"\$each\" Package)
    mkdir \"\$into\" && dpkg-deb --extract \"\$each\" \"\$into\" && mkdir -p \"\$into/DEBIAN\" &&
        dpkg-deb --field \"\$each\" Package Version Source >\"\$into/DEBIAN/control\" || exit 1
done"
mmdebstrap --quiet --mode=chrootless --variant=extract --include=python3.11,libstdc++6,base-files --extract-hook="$unpack" \
    bookworm /dev/null
loader=$(echo "$packages"/libc6/lib/*/ld-linux-*.so.*)
triplet=$(basename "$(dirname "$loader")")
search=$(printf '%s:' "$packages"/*/lib/"$triplet" "$packages"/*/usr/lib/"$triplet")

say "its Python"
for each in "$packages"/*/usr/lib/python3.11; do cp -a "$each" "$home/lib/"; done
rm -f "$home/lib/python3.11/sitecustomize.py" # leads to the machine's own
cp "$packages/python3.11-minimal/usr/bin/python3.11" "$home/lib/python"
cp "$loader" "$home/lib/fleetsight" # so is a process called that it starts
cat >"$home/bin/python3" <<'END'
#!/bin/sh
# Start this folder's Python by its own dynamic loader and libraries, wherever the folder is. What is set for other
# programs (LD_LIBRARY_PATH, PYTHONPATH and so on, as in a sourced ROS workspace) has no effect; LANG has none either.
unset LD_PRELOAD LD_AUDIT OPENSSL_ENGINES OPENSSL_MODULES
export OPENSSL_CONF=/dev/null # the robot's is for another OpenSSL
home=$(dirname "$(dirname "$(readlink -f "$0")")")
exec "$home/lib/fleetsight" --inhibit-cache --library-path "$home/lib" --argv0 "$home/bin/python3" \
    "$home/lib/python" -I -X utf8 "$@"
END
cat >"$home/bin/fleetsight" <<'END'
#!/bin/sh
exec "$(dirname "$(readlink -f "$0")")/python3" -m fleetsight "$@"
END
chmod 755 "$home"/bin/* "$home/lib/fleetsight" "$home/lib/python"

# Copy the shared libraries that a program or a library needs, and are not there yet.
copy_libraries() {
    local name arrow path rest listed
    listed=$("$loader" --inhibit-cache --library-path "$search" --list "$1") || fail "$1: $listed"
    while read -r name arrow path rest; do
        [ "$arrow" = "=>" ] || continue
        case $path in
        "$loader" | "$home"/*) ;;
        "$packages"/*)
            [ -e "$home/lib/$name" ] || cp "$path" "$home/lib/$name"
            path=${path#"$packages"/} && echo "${path%%/*}" >>"$work/taken"
            ;;
        *) fail "${1#"$home"/} needs $name, which no package has that is taken: add its package to --include" ;;
        esac
    done <<<"$listed"
}

say "shared libraries of Python"
# The C library loads some of its own by name, such as those that look for users; the robot's would not fit.
for each in "$packages"/libc6/lib/"$triplet"/lib*.so.* "$packages"/libgcc-s1/lib/"$triplet"/lib*.so.*; do
    [ -e "$home/lib/$(basename "$each")" ] || cp "$each" "$home/lib/"
done
echo libgcc-s1 >>"$work/taken"
copy_libraries "$home/lib/python"
for each in "$home"/lib/python3.11/lib-dynload/*.so; do copy_libraries "$each"; done

say "fleetsight[$extras]"
export PIP_DISABLE_PIP_VERSION_CHECK=1
"$python" -m pip wheel --quiet --no-deps --no-build-isolation --wheel-dir "$work" "$source"
wheel=$(echo "$work"/fleetsight-*.whl)
"$python" -m pip --python "$home/bin/python3" install --quiet --no-compile --only-binary :all: --target "$site" \
    --constraint "$source/constraints.txt" "$wheel[$extras]"
if ! [ -e "$site/onnxruntime" ] && ! [ -e "$site/torch" ]; then # nothing there runs them
    rm -rf "$site/services/detector/weights"
    sed -i '/^services\/detector\/weights\//d' "$site"/fleetsight-*.dist-info/RECORD
fi
rm -rf "$site/bin" "$site"/fleetsight-*.dist-info/direct_url.json # with the name of the temporary folder in them
sed -i '/^\.\.\/\.\.\/bin\/\|direct_url/d' "$site"/*.dist-info/RECORD
find "$site" -name '*.so*' -type f -print0 >"$work/wheels-libraries"
while IFS= read -r -d '' each; do copy_libraries "$each"; done <"$work/wheels-libraries"
# Compiled here, because who runs it may not write there; independent of times, so that the archive is always the same.
"$home/bin/python3" -m compileall -q -f --invalidation-mode unchecked-hash -s "$home" -p /opt/fleetsight "$home/lib"

say "licences"
printf '%s\n' python3.11-minimal libpython3.11-minimal libpython3.11-stdlib libc6 >>"$work/taken"
sort -u "$work/taken" | while read -r name; do
    documents=$packages/$name/usr/share/doc/$name
    while [ -L "$documents" ]; do # it has another package's, which is here since it depends on it
        documents=$(echo "$packages"/*/usr/share/doc/"$(readlink "$documents")")
    done
    cp "$documents/copyright" "$home/licences/$name"
    sed -n 's/^\(Package\|Version\|Source\): //p' "$packages/$name/DEBIAN/control" | paste -sd ' '
done >"$home/licences/packages.txt"
cp -L "$packages"/base-files/usr/share/common-licenses/{GPL-2,GPL-3,LGPL-2.1,LGPL-3} "$home/licences/" # others name them
cp "$source/LICENSE" "$home/licences/fleetsight"
cp "$source"/deploy/{gateway.yaml,space.yaml,enrolment.yaml,fleetsight-gateway.service,fleetsight-space@.service,fleetsight-renew.service,fleetsight-renew.timer} "$home/deploy/"

version=${wheel#"$work"/fleetsight-}
archive=$target/fleetsight-gateway-${version%%-*}-$(uname -m).tar.gz
chmod -R u=rwX,go=rX "$home"
tar --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$stamp" -C "$work" -cf - fleetsight | gzip -n >"$work/archive"
mv "$work/archive" "$archive"
say "$archive: $(du -h "$archive" | cut -f 1), unpacked $(du -sh "$home" | cut -f 1), made in $SECONDS s"
