#!/usr/bin/env bash
# The tables of docs/benchmark: the models that ship, judged on the test rows of the CMU and Bandai archives.
#
#   benchmarks/tables.sh path/to/cmu path/to/bandai OUT [REPEATS]
#
# Killed, it goes on where it was: what is done is not done again, and samples are kept. REPEATS, 20 by default, are
# those of the rows that are cheap to sample; AR costs two and a half times as much and has a quarter of them.
set -euo pipefail
cmu=$1 bandai=$2 out=$3 repeats=${4:-20}
few=$(( repeats / 4 > 0 ? repeats / 4 : 1 ))
cd "$(dirname "$0")/.."

judge() {  # NAME ARGUMENTS: a folder of results
  local name=$1
  shift
  [ -f "$out/$name/done" ] && return
  echo "== $name, $(date +%T)"
  python eval.py --data "$cmu" "$bandai" --out "$out/$name" --samples "$out/samples" "$@"
  touch "$out/$name/done"
}

judge main --run cmdm-small --run cdamd-small --repeats "$repeats" --no-multimodality --controls
judge multimodality --run cmdm-small --run cdamd-small --repeats 1
judge schedules --run cmdm-small --vary schedule=fss schedule=ar schedule=full num_steps=20,lag=1 --repeats "$few" \
  --no-multimodality
judge guidance --run cmdm-small --run cdamd-small --guidance 1 2 3 4 6 --repeats "$few" --no-multimodality
judge reconstruction --run cmdm-small --run cdamd-small --protocol reconstruction --repeats "$repeats" --controls
judge editing --run cdamd-small --protocol editing --vary mask=causal mask=bcm --repeats "$few"
judge long --run cmdm-small --protocol long-horizon --vary way=stream way=chain --repeats "$few" --limit 16 --controls
python eval.py --beside "$out"/{main,multimodality,schedules,guidance,reconstruction,editing,long} --report "$out/report"
