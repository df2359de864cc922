"""CMDM's causal VAE on features, aligned with a motion-language teacher (MAC-VAE) or not.

  motion-jax train --config part_tmr --workdir runs/teacher --data HumanML3D     first, then
  motion-jax train --config cmdm_tokenizer --workdir runs/tokenizer --data HumanML3D
  ... --config cmdm_tokenizer:small         the size that ships, on archives; also laptop, mini, tiny
  ... --config cmdm_tokenizer:snapmogen     essential (HumanML3D's first 67 numbers), kit, snapmogen, babel, with a
                                            teacher of the same data; as in snapmogen_tiny with a size behind

How sizes are written: docs/configs.md. `full` is the released code's configuration
(docs/papers/cmdm.md#tokenizer-training): 76.3 M parameters. Without a teacher (ablations/cmdm:c-vae/tokenizer) it is
the causal VAE of the paper's Table 4; its plain one is vae/tokenizer.

Expected: `full` has not been run. `small`, without a teacher: about an hour on two cores of an AMD EPYC; the tokenizer
that ships went on from there with one (pretrained/cmdm-small/README.md): 17.8 mm of joint error on Bandai's test
split, 46.2 on CMU's. `mini`, cut to 300 steps: 83 to 84 mm held out, about a minute (docs/benchmark/study_cmdm.md).
"""
from motion_jax import paper_tables
from motion_jax.configs import common

# Numbers a frame and what the data section says (docs/papers/cmdm.md#data-sets, a table that is ours by analogy for all
# but the first).
DATASETS = {
    "essential": (67, dict(layout="essential")),
    "kit": (251, dict(layout="full_kit")),
    "snapmogen": (296, dict(name="snapmogen", layout="snapmogen")),
    "babel": (135, dict(name="babel", layout="babel", kind="pairs")),
}


def get_config(size="full"):
  dataset, size = common.data_and_size(size, DATASETS, ("full", "small", "laptop", "mini", "tiny"))
  config = common.experiment("cmdm.tokenizer", seed=5427)
  # teacher: the run folder of configs/part_tmr.py; "": no alignment. evaluator: by which validation chooses weights.
  config.frozen = dict(teacher="runs/teacher", evaluator="")
  config.teacher = dict()    # its fields; the run takes them from there
  config.alignment_teacher = dict()  # where its weights came from, too
  config.model = dict(features=263, latent_dim=64, width=1024, num_halvings=2, dilations=(9, 3, 1), teacher_dim=256,
                      causal=True, decoder_width=0)  # of the decoder, if it has a width of its own
  # align falls by the share align_fall of it. Other choices of the last fields: configs/ablations/cmdm_paper.py.
  config.loss = dict(kl_weight=0.01, kl_ramp=2_000, root_weight=0.05, micro_batch=128, align=0.1, align_fall=0.9,
                     adaptive_align=True, reconstruction="gaussian", distance_pairs="window", last_layer="convolution",
                     **common.motion_errors(), **common.critic())
  # short_window: length in frames of the windows in every second batch; 0: none (data/batches.py).
  # balance: windows of rare actions are drawn more often; 0 each once an epoch, 1 all actions alike.
  config.data = common.data(layout="full", batch_size=256, window=64, stride=10, short_window=0, balance=0.0)
  if dataset:
    config.model.features, data = DATASETS[dataset]
    config.data.update(data)
  config.optimizer = common.optimizer(learning_rate=2e-4, schedule="step", boundaries=(150_000, 250_000), gamma=0.1,
                                      warmup_steps=2_000, beta2=0.99, clip_norm=1.0)
  # best: the weights of the lowest reconstruction FID of held-out clips are kept, as the reference keeps them, where
  # frozen.evaluator names the evaluator (of 263 features), else those of the smallest joint error.
  config.train = common.epochs(50, log_every=50, num_saves=50, best="min held_out_fid|held_out_mm",
                               sample_every=10_000)
  if size in ("small", "mini", "laptop"):
    config.model.update(latent_dim=32, width=192, teacher_dim=64)
    # A heading or a step that is a little off adds up over a clip, and a small model has no capacity to spare.
    config.loss.update(micro_batch=32, kl_weight=0.5, kl_ramp=1_000, root_weight=10.0)
    common.archives(config, batch_size=32)
    config.optimizer.update(learning_rate=6e-4, schedule="wsd", warmup_steps=200, cooldown_steps=2_500,
                            ema_decay=0.999)
    config.train.update(num_steps=8_500, log_every=50, save_every=1_000, best="")
    if size in ("mini", "laptop"):
      config.model.update(width=128)
      config.loss.update(kl_ramp=100)
      config.optimizer.update(learning_rate=1e-3, warmup_steps=50, cooldown_steps=300, ema_decay=0.99)
      config.train.update(num_steps=900, save_every=450)
    if size == "laptop":
      config.optimizer.update(cooldown_steps=900, ema_decay=0.995)
      config.train.update(num_steps=3_000, log_every=10, save_every=500)
  elif size == "tiny":
    config.frozen.teacher = "random-init"  # nothing to train first
    config.teacher = dict(width=16, depth=1, num_heads=2, mlp_width=16, dim=8)  # part_tmr:tiny's
    config.model.update(latent_dim=4, width=16, dilations=(1,), teacher_dim=8)
    config.loss.update(micro_batch=2, kl_ramp=2)
    common.tiny(config)
    if dataset == "kit":
      config.data.window = 32  # 12.5 frames a second
    config.optimizer.update(warmup_steps=1)
    config.train.best = ""
  rows = {} if dataset else {"cmdm 8": paper_tables.CMDM["cmdm 8"], "cmdm 9": paper_tables.CMDM["cmdm 9"]}
  return paper_tables.with_rows(config, rows, exact=size == "full").lock()
