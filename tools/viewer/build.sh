#!/bin/sh
# Bundles three.js, OrbitControls and src/ into motion_jax/export/assets/viewer.js. Needs node; run it after a change:
#   cd tools/viewer && npm install --no-package-lock && sh build.sh
set -eu
cd "$(dirname "$0")"
out=../../motion_jax/export/assets/viewer.js
npx esbuild src/main.js --bundle --minify --format=iife --target=es2020 --legal-comments=none --outfile=viewer.tmp.js
{
  echo "/* motion_jax viewer, Apache-2.0. Contains three.js, MIT License:"
  sed 's/^/ * /' node_modules/three/LICENSE
  echo " */"
  sed 's#</script#<\\/script#g; s#<!--#<\\!--#g' viewer.tmp.js  # the bundle lives inside a script element
} > "$out"
rm viewer.tmp.js
wc -c "$out"
