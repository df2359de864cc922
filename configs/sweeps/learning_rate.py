"""CMDM's denoiser at three learning rates, and the middle one with a larger batch.

  python benchmarks/sweep.py learning_rate --workdir runs/learning_rate --data path/to/cmu path/to/bandai \
      --config.frozen.tokenizer=runs/tokenizer
  sbatch --array=0-3 --wrap "python benchmarks/sweep.py learning_rate --workdir runs/learning_rate ..."

A sweep is a file with get_sweep(size) -> {name of a run: (config, {field: value})}. Expected: nothing has been run.
"""
RATES = (2e-4, 5e-4, 1e-3)


def get_sweep(size="mini"):
  config = f"cmdm_denoiser:{size}"
  runs = {f"rate-{rate:g}": (config, {"optimizer.learning_rate": rate}) for rate in RATES}
  return runs | {"rate-0.0005-batch-64": (config, {"optimizer.learning_rate": 5e-4, "data.batch_size": 64})}
