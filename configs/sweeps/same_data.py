"""Seven methods and MARDM on the same data, with the same processor time and about the same number of parameters.

  python benchmarks/sweep.py same_data --workdir runs/same-data --data path/to/cmu path/to/cmu2 path/to/bandai \
      --cpu-seconds 7200 --slice 300
  python benchmarks/sweep_table.py same_data runs/same-data --data path/to/cmu path/to/bandai --page PAGE.md

The budget is that of a method; its stages share it. The first command may be stopped and started again, also with a
larger budget, and the second makes a table of the models at any moment: docs/lab/same-data-same-budget.md.

All methods have the archives' own captions, mirrored clips, the same text encoder, batches of 16 clips (32 windows of
64 frames for tokenizers of windows), a constant learning rate after a short warm-up and averaged weights, so that no
schedule has to know when training ends. Widths and depths are chosen for 3.3 to 3.6 million parameters in the networks
that make a motion; representations are those that each method has in this library on archives.

Size "gpu", which has not been trained yet, is for a number of steps instead of a budget, with batches of 128 clips and
256 windows, a method in each task of an array:

  SLURM_ARRAY_TASK_ID=0 python benchmarks/sweep.py same_data:gpu --workdir runs/same-data --data ...
"""
TOKENIZER, GENERATOR = 0.3, 0.7  # shares of the budget
GPU_STEPS = 4000  # of a method


def get_sweep(size="laptop"):
  tiny, gpu = size == "tiny", size == "gpu"
  size = "tiny" if tiny else "laptop"

  def stage(config, share, fields=None, sizes=None, clips=True):
    common = {"train.num_steps": 10_000_000, "train.save_every": 1_000_000, "train.sample_every": 0}
    learning = {"optimizer.schedule": "constant", "optimizer.warmup_steps": 50, "optimizer.ema_decay": 0.99}
    batch = {"data.batch_size": 16} if clips else {}
    if gpu:
      common["train.num_steps"] = round(GPU_STEPS * share)
      batch = {"data.batch_size": 128 if clips else 256}
    changed = common | ({} if tiny else learning | batch | (sizes or {})) | (fields or {})
    return config if ":" in config else f"{config}:{size}", changed, share

  steps, mardm = f"steps_{size}", "mardm_67_tiny" if tiny else "mardm_67_mini"
  narrow = {"model.width": 176, "model.ff_width": 448}
  return {
      "cmdm/tokenizer": stage("cmdm_tokenizer", TOKENIZER, {"frozen.teacher": "", "model.teacher_dim": 0}, clips=False),
      "cmdm/denoiser": stage("cmdm_denoiser", GENERATOR, {"frozen.tokenizer": "{cmdm/tokenizer}"},
                             {"model.width": 160, "model.ff_width": 320}),
      "cdamd/autoencoder": stage(f"cdamd_autoencoder:{steps}", 0.2, clips=False),
      "cdamd/rvq": stage(f"cdamd_rvq:{steps}", 0.1, clips=False),
      "cdamd/generator": stage(f"cdamd_generator:{steps}", GENERATOR, {
          "frozen.tokenizer": "{cdamd/autoencoder}", "frozen.prior": "{cdamd/rvq}"}, {"model.head.width": 256}),
      "mardm/autoencoder": stage(f"cdamd_autoencoder:67_{size}", TOKENIZER, clips=False),
      "mardm/generator": stage(f"cdamd_generator:{mardm}", GENERATOR, {"frozen.tokenizer": "{mardm/autoencoder}"},
                               {"model.head.width": 192}),
      "mdm/denoiser": stage("mdm_denoiser", 1.0),
      "mld/vae": stage("mld_vae", 0.5),
      "mld/denoiser": stage("mld_denoiser", 0.5, {"frozen.tokenizer": "{mld/vae}"}),
      "t2m_gpt/vq": stage("t2m_gpt_vq", TOKENIZER, clips=False),
      "t2m_gpt/gpt": stage("t2m_gpt_gpt", GENERATOR, {"frozen.tokenizer": "{t2m_gpt/vq}"}, {"model.depth": 7}),
      "momask/rvq": stage("momask_rvq", TOKENIZER, clips=False),
      "momask/residual": stage("momask_residual", 0.3, {"frozen.tokenizer": "{momask/rvq}"}, narrow),
      "momask/masked": stage("momask_masked", 0.4, {
          "frozen.tokenizer": "{momask/rvq}", "frozen.residual": "{momask/residual}"}, narrow),
      "motionstreamer/tokenizer": stage("motionstreamer_tokenizer", TOKENIZER, sizes={"model.width": 128}, clips=False),
      "motionstreamer/generator": stage(
          "motionstreamer_generator", GENERATOR, {"frozen.tokenizer": "{motionstreamer/tokenizer}"},
          {"tokenizer.width": 128, "model.transformer.width": 144, "model.transformer.depth": 4,
           "model.head.width": 192, "model.head.depth": 3, "loss.replace_ramp": 600}),
  }
