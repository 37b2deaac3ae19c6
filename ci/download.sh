#!/bin/sh
# Downloads a released karat with its checksum: sh download.sh RELEASES VERSION FOLDER
# The program goes to FOLDER/bin. Exits with 3 if there is no archive for this machine, so that a caller may
# build karat instead; with 1 if the archive isn't what its checksum says.
set -eu

releases=$1 version=$2 folder=$3
case "$(uname -s) $(uname -m)" in
    "Linux x86_64") target=x86_64-unknown-linux-gnu ;;
    "Linux aarch64") target=aarch64-unknown-linux-gnu ;;
    "Darwin x86_64") target=x86_64-apple-darwin ;;
    "Darwin arm64") target=aarch64-apple-darwin ;;
    *)
        echo "karat: no archive is built for $(uname -s) on $(uname -m)" >&2
        exit 3
        ;;
esac
name=karat-$version-$target
archive=$releases/v$version/$name.tar.gz
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

if ! curl --fail --silent --show-error --location --retry 2 --output "$work/$name.tar.gz" "$archive"; then
    echo "karat: there is no archive at $archive" >&2
    exit 3
fi
if ! curl --fail --silent --show-error --location --retry 2 --output "$work/$name.tar.gz.sha256" "$archive.sha256"; then
    echo "karat: $archive has no checksum beside it, so it isn't used" >&2
    exit 1
fi
# Of the file that was asked for, whatever name stands beside the digest.
wanted=$(cut -d ' ' -f 1 "$work/$name.tar.gz.sha256")
if command -v sha256sum > /dev/null; then
    found=$(sha256sum "$work/$name.tar.gz")
else
    found=$(shasum -a 256 "$work/$name.tar.gz")
fi
if [ "${#wanted}" -ne 64 ] || [ "${found%% *}" != "$wanted" ]; then
    echo "karat: $archive has the checksum ${found%% *}, and not $wanted" >&2
    exit 1
fi
tar -xzf "$work/$name.tar.gz" -C "$work"
# Linux without glibc can't run it.
if ! "$work/$name/karat" --version > /dev/null; then
    echo "karat: the archive's program doesn't run on this machine" >&2
    exit 3
fi
mkdir -p "$folder/bin"
cp "$work/$name/karat" "$folder/bin/karat"
