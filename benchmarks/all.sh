#!/usr/bin/env bash
# Measures what docs/performance.md says and writes that page: benchmarks/all.sh [--quick] [--busy] [OUT]
# OUT, benchmarks/data/performance by default, gets a row a measurement; what is there is left alone, so the same command
# continues a run that was cut short, and a row that is deleted is measured again. --quick: a shorter list, about eight
# minutes. It refuses a machine on which other work uses more than 0.2 cores; --busy measures anyway and marks the rows.
set -euo pipefail
cd "$(dirname "$0")/.."
export PYTHONPATH="$PWD${PYTHONPATH:+:$PYTHONPATH}"
quick=() busy=false out=benchmarks/data/performance
for argument in "$@"; do
  case $argument in
    --quick) quick=(--quick) ;;
    --busy) busy=true ;;
    -*) echo "got $argument, expected --quick, --busy or a folder" >&2; exit 2 ;;
    *) out=$argument ;;
  esac
done
mkdir -p "$out"
others=$(cd benchmarks && python3 -c 'import machine; print(machine.mark(machine.load(3)))')
if [ -n "$others" ]; then
  echo "this machine is not quiet ($others)" >&2
  [ "$busy" = true ] || { echo "wait until it is, or measure with --busy, which marks the rows" >&2; exit 3; }
fi

[ -f "$out/time_to_motion.json" ] || python3 benchmarks/time_to_motion.py --out "$out/time_to_motion.json" \
  --rounds $([ ${#quick[@]} = 0 ] && echo 3 || echo 1)
python3 benchmarks/throughput.py "$out/rows.jsonl" ${quick[@]+"${quick[@]}"}
if [ ! -f "$out/training.md" ] && [ -f benchmarks/train_step.py ]; then
  if python3 -c 'import torch' 2>/dev/null; then
    python3 benchmarks/train_step.py | tee "$out/training.part" && mv "$out/training.part" "$out/training.md"
  else
    echo "without PyTorch (extra convert) no training step is compared"
  fi
fi
if [ ! -f "$out/peers.md" ] && [ -n "${PEERS:-}" ]; then  # PEERS: the clones that method_peers.py --list names
  python3 benchmarks/method_peers.py --peers "$PEERS" --out "$out/peers.md"
fi
python3 benchmarks/roofline.py "$out/roofline.jsonl"
python3 benchmarks/performance_page.py "$out" "${PERFORMANCE_PAGE:-docs/performance.md}"
