"""What the experiments share: names of sizes, fields that all have, the archives' settings, rows of ablation tables.

How a size is written, [DATA_]SIZE, and what each size is for: docs/configs.md.
"""
import ml_collections

from motion_jax import paper_tables

# What evaluators read: {name: (layout, its numbers a frame, how many of them are read)}. Full features are read without
# the contacts at their end.
EVALUATED = {"full": ("full", 263, 259), "67": ("essential", 67, 67), "66": ("coordinates", 66, 66),
             "kit": ("full_kit", 251, 247), "64": ("essential_kit", 64, 64), "63": ("coordinates_kit", 63, 63)}
KIT_EVALUATED = ("kit", "64", "63")


def experiment(stage, seed):
  """A config that names its stage, and how its step is mapped over the devices."""
  config = ml_collections.ConfigDict()
  config.stage, config.seed = stage, seed
  config.mesh = mesh()
  return config


def mesh():
  """The section `mesh`: how a step is mapped over devices (docs/pods.md).

  map: "auto", "pmap" or "shard_map". layout: "replicated", "tensor" or "fully_sharded"; rules: pairs of a name of axes
  (nets/partitioning.py) and "data" or "model", in place of the layout's. data, model: number of devices that a batch,
  and one copy of the parameters, is split over; data 0: all that model leaves.
  """
  return dict(map="auto", layout="replicated", rules=(), data=0, model=1)


def data_and_size(name, data, sizes):
  """(data, size) of a name DATA, SIZE or DATA_SIZE; data is "" and size "full" where they are left out."""
  first, _, rest = name.partition("_")
  found = (first, rest or "full") if first in data else ("", name)
  if found[1] not in sizes:
    raise ValueError(f"got size {name!r}, expected {', '.join(sizes[:-1])} or {sizes[-1]}"
                     + (f", or one of {', '.join(data)} before it" if data else ""))
  return found


def words_of(name, sizes, *groups):
  """(size, one word of each group, "" where there is none) of a name of words joined by "_", as in dip_kit_tiny; the
  size is sizes[0] where it is left out."""
  words, found = name.split("_"), []
  for group in (sizes, *groups):
    mine = [word for word in words if word in group]
    found.append(mine[0] if len(mine) == 1 else "" if not mine else None)
  if None in found or sum(bool(word) for word in found) < len(words):
    raise ValueError(f"got size {name!r}, expected {', '.join(sizes[:-1])} or {sizes[-1]}, with one of "
                     + " and one of ".join(", ".join(group) for group in groups) + " before it where wanted")
  return found[0] or sizes[0], *found[1:]


def evaluated_size(name):
  """(size, layout, its numbers a frame, how many are read) of an evaluator's name; small ones read coordinates."""
  names = ("67", "66", "kit", "64", "63", "full", "small", "laptop", "tiny")
  if name not in names:
    raise ValueError(f"got size {name!r}, expected {', '.join(names[:-1])} or {names[-1]}")
  return name, *EVALUATED.get(name, EVALUATED["66"])


def data(**fields):
  """The section `data` on HumanML3D; folder or folders: its location. kinematic_captions: whether clips of archives get
  captions by kinematics beside their own (docs/captions.md). paraphrases: the most sentences in other words that each
  caption of a training clip of archives gets beside it (docs/captions.md#paraphrases). augment: number of new clips of
  each kind made of the training clips of archives, as a share of these (docs/augmentation.md). feature_bias: what the
  std of turn, root and contacts of a data set's own statistics is divided by; 0: nothing
  (docs/papers/momask.md#statistics). workers: number of processes that make clips, captions and features of archives,
  equal to those of one; 0: this one. source_weights: pairs (archive, factor), how much more or less often than others
  its clips are drawn (docs/training.md#balance); source_shares: pairs (archive, share of all draws)."""
  return dict(name="humanml3d", folder="", folders=(), mode="benchmark", mirror=False, kinematic_captions=False,
              paraphrases=0, feature_bias=0.0, workers=0, source_weights=(), source_shares=(),
              augment=dict(stitched=0.0, bent_paths=0.0, idle=0.0, counted=0.0, excerpts=0.0, seats=0.0,
                           stepping=0.0, postures=0.0, wandering=0.0, time_warp=0.0)) | fields


def captioned_data(**fields):
  """The section `data` of clips that are cut and padded for training with captions: fields of `data.batches.TextItems`.

  shorten_rate: how often a clip loses the frames of one latent; crop_frames: the most frames that it keeps, 0 for
  data.max_frames.
  """
  return data(frames_per_latent=4, crop_frames=0, keep_long=False, shorten_rate=1 / 3) | fields


# SnapMoGen's 296 numbers, clips as CMDM's own there (configs/cmdm_denoiser.py): of up to 320 frames, cut out of longer.
SNAPMOGEN = dict(name="snapmogen", layout="snapmogen", min_frames=128, max_frames=320)


def motion_errors():
  """Weights, in a tokenizer's or denoiser's section `loss`, of errors in how the decoded motion moves; 0: off, as in
  the papers.

  acceleration of all joints; velocity of wrists, ankles and toes; velocity of feet that stand in the real motion,
  and of feet that are down for a moment; lengths of bones, and their directions; the size of speeds, accelerations
  and jerks, on a logarithmic scale (models/motion_errors.py).
  """
  return dict(acceleration=0.0, extremity_velocity=0.0, foot_contact=0.0, brief_contact=0.0, bone_length=0.0,
              limb_direction=0.0, dynamics=0.0)


def critic():
  """A critic of the decoded motion, in a tokenizer's section `loss`; 0: off, as in the papers.

  critic: weight of its adversarial term, from step critic_after on; critic_matching: of feature matching;
  critic_width: channels of its first layers (models/shared/critic.py). Its learning rate: optimizer.rates.
  """
  return dict(critic=0.0, critic_matching=0.0, critic_after=0, critic_width=64)


def contrast():
  """How a generator learns, in its section `loss`, to follow the side, count, pace and direction of a caption
  (docs/training.md#contradicting-captions): the weight of what the error with a caption that contradicts the motion
  lacks to be larger by the margin, of latents whose time is below contrast_until (0 noise, 1 clean); 0: off."""
  return dict(contrast=0.0, contrast_margin=0.1, contrast_until=0.5)


def cleanup():
  """The section `cleanup` of a generator: how many frames the cleanup of its motions smooths over; 0: not at all, for a
  decoder that was trained with loss.dynamics (docs/lab/believed.md)."""
  return dict(smoothing=0.7)


def optimizer(learning_rate, **fields):
  """The section `optimizer`: AdamW without weight decay at a constant rate, unless fields change it.

  name, fields: any optimizer of optax and its arguments; schedule, schedule_fields: the same for the learning rate
  (training/optimizers.py). A step is skipped if its loss is above skip_loss, or its gradient above skip_spikes times
  the median of those before; 0 skips none. ema_decay: of the average of parameters that is evaluated; 0: none.
  ema_debias: the average leaves out the random start; without it, as in the released code, it begins as a copy of the
  start, of which ema_decay ** steps is left. warmup: "full", or "released" as in MoMask's and T2M-GPT's code
  (docs/papers/momask.md#training). accumulate_steps: number of parts of a device's batch, which are computed
  one after the other in less memory, for a step that is the same up to rounding.
  """
  return dict(name="adamw", fields={}, learning_rate=learning_rate, schedule="constant", schedule_fields={},
              cooldown_steps=0, warmup_steps=0, beta1=0.9, beta2=0.999, weight_decay=0.0, clip_norm=0.0, ema_decay=0.0,
              ema_debias=False, skip_loss=0.0, skip_spikes=0.0, accumulate_steps=1, final_rate=0.0, boundaries=(),
              gamma=0.1, rates={}, clip_parts=(), warmup="full") | fields


def train(num_steps, log_every, save_every, **fields):
  """The section `train`: from random weights, keeping the last ones, where fields do not say otherwise.

  num_steps is the length of a run, with a save every save_every steps. Where it is 0, the length is num_epochs times
  the training data, of which each item, a window or a captioned clip, comes once an epoch, with num_saves saves:
  training prints how many steps they are.
  dtype: what the stage's network computes in, "float32" or "bfloat16"; parameters, norms, softmax and losses stay
  float32. keep_last: how many training states stay, besides the best one. A run that leaves out
  max_skips steps in a row goes back to its last good state and on with other batches, max_rollbacks times at most.
  After hang_minutes without a step it ends; 0 never. cpu_seconds: processor time of its steps, over all its slices,
  after which it ends, too; 0: no limit. seconds: by the clock, of steps, after which a run of the schedule "wsd" has
  ended with its cooldown, for which it leaves out steps before; num_steps is then the most. workers: processes of
  Grain that make batches; 0 for a thread.
  remat, where dtype is: whether a gradient computes what is inside of a network's blocks once more instead of keeping
  it: less memory, a third more work. attention, where it is: "cudnn" computes attention in 16 bits by NVIDIA's fused
  kernel; elsewhere that is the same as "xla". scan_layers, where it is: whether one layer of the network is compiled
  and run as often as there are layers, instead of each. tensorboard: whether metrics are written as an event file, too.
  sample_every: pictures of what the run makes, in its samples/, at the saves nearest to multiples of it; 0: none.
  start: a run, or a name that ships, whose parameters are the first ones; freeze: names of parts that stay as they are
  there, such as ("encoder",): then a tokenizer's latents mean what they meant, and its generators go on with it.
  start_parts: names of the only parts taken from there, for networks whose other parts have another size.
  """
  return dict(start="", start_parts=(), freeze=(), dtype="float32", num_steps=num_steps, num_epochs=0,
              log_every=log_every, save_every=save_every, num_saves=20, best="", keep_last=2, max_skips=20,
              max_rollbacks=3, hang_minutes=60.0, workers=0, cpu_seconds=0.0, seconds=0.0, tensorboard=False,
              sample_every=0) | fields


def archives(config, **fields):
  """Data of the small sizes: archives of motion capture, each clip mirrored too. They train for so few steps that an
  average would keep some of the random start."""
  config.data.update(name="archive", mode="corrected", mirror=True, **fields)
  config.train.num_epochs = 0  # their steps are counted
  config.optimizer.ema_debias = True


def epochs(num_epochs, log_every, num_saves, **fields):
  """The section `train` of a run that is counted in epochs of its data."""
  return train(0, log_every, 0, num_epochs=num_epochs, num_saves=num_saves, **fields)


def tiny(config, **fields):
  """Two steps on procedural motion: nothing to download, seconds on a laptop."""
  config.data.update(name="synthetic", mode="corrected", batch_size=4, **fields)
  config.train.update(num_steps=2, num_epochs=0, log_every=1, save_every=2, sample_every=0)
  config.optimizer.update(warmup_steps=min(config.optimizer.warmup_steps, 1), ema_debias=True)


def small_teacher(config, **fields):
  """What all motion-language teachers have on the archives."""
  archives(config, batch_size=64, max_frames=96, **fields)
  config.optimizer.update(learning_rate=1e-3, warmup_steps=100, schedule="cosine", ema_decay=0.995, clip_norm=1.0)


def mini_teacher(config):
  """What the teachers of the paper's Table 9 have at the size mini."""
  config.data.batch_size = 32
  config.optimizer.update(warmup_steps=20, ema_decay=0.98)
  config.train.update(num_steps=400, log_every=20, save_every=200)


def same_words_are_no_counter_examples(config):
  """Template captions repeat inside a batch; the same words cannot be a counter-example."""
  config.loss.update(text_pool="mean", skip_same_caption=True)


# --- rows of ablation tables ---------------------------------------------------------------------------------------


def row_stage_size(name, rows, stages, sizes=None):
  """(row, stage, size) of ROW[/STAGE[/SIZE]]: the last stage, and full, where they are left out."""
  row, stage, size = (name.split("/") + [list(stages)[-1], "full"][name.count("/"):])[:3]
  for what, given, known in (("row", row, rows), ("stage", stage, stages), ("size", size, sizes)):
    if known is not None and given not in known:
      raise ValueError(f"got {what} {given!r}, expected one of {', '.join(known)}")
  return row, stage, size


def take_parts(config, row, changes, parts):
  """Frozen parts, {stage: field of config.frozen}, from where the run of the row, or of the default, lies."""
  for part, field in parts.items():
    config.frozen[field] = f"runs/ablations/{row if part in changes else 'default'}/{part}"


def set_fields(config, fields):
  """fields: {SECTION.FIELD: value}."""
  for path, value in fields.items():
    section, field = path.split(".")
    config[section][field] = value


def as_the_paper_writes(config):
  """The config, locked, without a printed row: which side made the papers' numbers is not known."""
  if "paper_row" in config:
    paper_tables.with_rows(config, {})
  return config.lock()
