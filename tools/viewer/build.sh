#!/bin/sh
# Bundles three.js, OrbitControls and src/ into the file that is given, motion_jax/export/assets/viewer.js for one. After
# a change of src/ run (node and npm):
#   python tools/build_docs.py --files
set -eu
cd "$(dirname "$0")"
out=$1  # in this folder, or an absolute path
npx esbuild src/main.js --bundle --minify --format=iife --target=es2020 --legal-comments=none --log-level=warning --outfile=viewer.tmp.js
{
  echo "/* motion_jax viewer, Apache-2.0. Contains three.js, MIT License:"
  sed 's/^/ * /' node_modules/three/LICENSE
  echo " */"
  sed 's#</script#<\\/script#g; s#<!--#<\\!--#g' viewer.tmp.js  # the bundle lives inside a script element
} > "$out"
rm viewer.tmp.js
