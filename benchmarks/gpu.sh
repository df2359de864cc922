#!/usr/bin/env bash
# Measures on an accelerator all that this project wants to know of it: benchmarks/gpu.sh [FILE [SECONDS [OPTIONS]]]
# writes a row a piece to FILE (.jsonl; by default benchmarks/data/gpu/DEVICE.jsonl) and a page of them, FILE's name with
# .md (by default docs/benchmark/gpu/DEVICE/README.md). It begins nothing after SECONDS, 500 by default. The same command again measures what is still missing, and leaves what is there.
# OPTIONS: those of benchmarks/accelerator.py, such as --only fss/M. COMPILERS: number of processes that compile before
# anything is measured, for half of the time at most; 1 by default, for which each piece is compiled when it is measured.
# They share the device's memory in equal parts.
# Without an accelerator it refuses, unless --tiny is given, which tries everything at tiny sizes on a CPU.
set -euo pipefail
cd "$(dirname "$0")/.."
export PYTHONPATH="$PWD${PYTHONPATH:+:$PYTHONPATH}"
began=$SECONDS seconds=${2:-500} options=("${@:3}") compilers=${COMPILERS:-1}
name=$(python3 -c 'import jax; print(jax.default_backend(), jax.devices()[0].device_kind.replace(" ", "-").lower())')
if [ "${name%% *}" = cpu ] && [[ " ${options[*]-} " != *" --tiny "* ]]; then
  echo "jax sees no accelerator here: install a build for one (pip install 'motion-jax[cuda13]'), or try with --tiny" >&2
  exit 2
fi
out=${1:-benchmarks/data/gpu/${name#* }.jsonl} page=docs/benchmark/gpu/${name#* }/README.md
[ $# = 0 ] || page=${out%.jsonl}.md
if [ "$compilers" -gt 1 ]; then
  # A cache on disk, so that the process that measures finds what the others have compiled.
  export JAX_COMPILATION_CACHE_DIR=${JAX_COMPILATION_CACHE_DIR:-$(mktemp -d)}
  export JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS=0 JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES=-1
  for i in $(seq 0 $((compilers - 1))); do
    XLA_PYTHON_CLIENT_PREALLOCATE=false XLA_PYTHON_CLIENT_MEM_FRACTION=$(printf 0.%03d $((800 / compilers))) \
      timeout $((seconds / 2)) python3 benchmarks/accelerator.py "$out" --compile "$i/$compilers" \
      ${options[@]+"${options[@]}"} &
  done
  wait || true
  echo "compiled by $compilers processes in $((SECONDS - began)) s"
fi
# A program that a piece has ended leaves that piece marked, and the rest is tried by a new one.
while left=$((seconds - (SECONDS - began))) && [ "$left" -gt 0 ]; do
  status=0
  python3 benchmarks/accelerator.py "$out" --seconds "$left" ${options[@]+"${options[@]}"} || status=$?
  if [ "$status" = 1 ] || [ "$status" = 2 ]; then exit "$status"; fi
  if [ "$status" = 0 ] || [ "$status" = 75 ]; then break; fi
done
python3 benchmarks/accelerator.py "$out" --table "$page"
echo "wrote $page"
