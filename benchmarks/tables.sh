#!/usr/bin/env bash
# The tables of docs/benchmark: the models that ship, judged on the test rows of the CMU and Bandai archives.
#
#   benchmarks/tables.sh path/to/cmu path/to/bandai OUT [REPLICATIONS]
#
# Killed, it goes on where it was: what is done is not done again, and samples are kept. REPLICATIONS, 20 by default,
# are those of the rows that are cheap to sample; AR costs two and a half times as much and has a quarter of them.
set -euo pipefail
cmu=$1 bandai=$2 out=$3 replications=${4:-20}
few=$(( replications / 4 > 0 ? replications / 4 : 1 ))
cd "$(dirname "$0")/.."

judge() {  # NAME ARGUMENTS: a folder of results
  local name=$1
  shift
  [ -f "$out/$name/done" ] && return
  echo "== $name, $(date +%T)"
  motion-jax evaluate --data "$cmu" "$bandai" --out "$out/$name" --samples "$out/samples" "$@"
  touch "$out/$name/done"
}

judge main --model cmdm-small --model cdamd-small --replications "$replications" --no-multimodality --controls
judge multimodality --model cmdm-small --model cdamd-small --replications 1
judge schedules --model cmdm-small --vary schedule=fss schedule=ar schedule=full num_steps=20,lag=1 \
  --replications "$few" --no-multimodality
judge guidance --model cmdm-small --model cdamd-small --guidance-scale 1 2 3 4 6 --replications "$few" --no-multimodality
judge reconstruction --model cmdm-small --model cdamd-small --protocol reconstruction --replications "$replications" \
  --controls
judge editing --model cdamd-small --protocol editing --vary mask=causal mask=bcm --replications "$few"
judge editing-finished --model cdamd-small --protocol editing --sampling mask=bcm cleanup=true --replications "$few"
judge long --model cmdm-small --protocol long-horizon --replications "$few" --limit 16 --controls \
  --vary way=stream way=stream,ease=true way=stream,memory=3 way=stream,memory=48 way=chain
# As a person sees them: cleaned up, borders eased.
judge long-shown --model cmdm-small --protocol long-horizon --sampling cleanup=true ease=true \
  --vary way=stream way=joined --replications "$few" --limit 16
motion-jax evaluate \
  --compare-with "$out"/{main,multimodality,schedules,guidance,reconstruction,editing,editing-finished,long,long-shown} \
  --report "$out/report"
