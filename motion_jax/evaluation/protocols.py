"""Benchmarks by name: how each turns a test split into a row of numbers, every quirk a named field.

  name             data                     evaluator reads      what is judged
  archives-66      archives (our own)       66 coordinates       text to motion, on motion capture that anyone may fetch
  own-66           a `data build` folder    66 coordinates       text to motion, on your own data
  cmdm-259         HumanML3D                263 (259 of them)    text to motion, CMDM Table 1
  cmdm-67          HumanML3D                67                   text to motion, CMDM Table 6
  cdamd-66         HumanML3D                66 coordinates       text to motion, CDAMD Tables I, IV, V
  t2m-263          HumanML3D                263 (259 of them)    text to motion, the protocol of T2M and most papers
  kit              KIT-ML                   63, 64 or 251        text to motion, CDAMD Table II
  snapmogen        SnapMoGen                148                  text to motion, CMDM Table 2
  long-horizon     HumanML3D or archives    any                  32 prompts in a row, CMDM Table 3
  snapmogen-long   SnapMoGen                148                  recordings' own motions in a row, CMDM Table 3
  babel            BABEL                    135                  prompts in a row, CMDM Table 5
  mtt              timelines and clips      any, kind "tmr"      timelines, CMDM Table 7
  control          archives or HumanML3D    any                  joints at given positions, OmniControl's
  editing          any of the first four    any                  four editing tasks, CDAMD Table III
  reconstruction   any of the first four    any                  a tokenizer there and back, CMDM Table 8

Numbers of `archives-66` and `own-66` are our own benchmark's: they compare with nothing on HumanML3D.
"""
import dataclasses

from motion_jax.metrics.protocol import Protocol
from motion_jax.utils.nearest import did_you_mean


@dataclasses.dataclass(frozen=True)
class Benchmark(Protocol):
  """A named protocol. Fields of `metrics.protocol.Protocol` are those of the scores; these are the rest.

  Items: clips of min_frames <= rows < past_frames of a split, each time tag by itself, cut to max_frames. For each item
  a replication draws a caption, whether to shorten it by one unit (one time in three), and the start of the cut; items
  are shuffled and dealt in batches of `pool`, without the last partial one.
  """
  name: str = ""
  title: str = ""
  source: str = ""                       # where its rules are from
  task: str = "generation"               # a name of `tasks.registry.TASKS`
  formats: tuple[str, ...] = ("humanml3d",)
  layouts: tuple[str, ...] = ()          # representations that the evaluator may read; none named: any
  kinds: tuple[str, ...] = ("t2m",)      # of evaluators that its numbers come from, see `evaluators.evaluator`
  evaluator: str | None = None           # by default: a name that ships, or None where there is none
  clip_evaluator: str | None = None
  split: str = "test"
  seed: int = 0
  # items
  min_frames: int = 40
  past_frames: int = 200                 # a clip has fewer rows than this
  max_frames: int = 196
  unit_length: int = 4                   # lengths are multiples of it
  random_caption: bool = True            # False: an item's first one
  coin: bool = True                      # shorten one item in three by a unit; Parity: also in evaluation
  random_crop: bool = True               # False: from the first row
  shuffle: bool = True
  sort_by_caption: bool = True           # inside a batch, longest sentence first; no score looks at it
  # generated motions
  # After a motion's last frame: "zeros", or "decoded", the decoder's own rows there. Parity: the released code of CDAMD
  # keeps them. Real motions and files of other programs have none, so our own protocols judge every row without.
  made_padding: str = "zeros"
  # multimodality
  multimodality_captions: int | None = None  # else multimodality_batches * pool
  multimodality_replications: int | None = None  # how many have it; None: all
  multimodality_shared: bool = False     # Parity: the other scores of these captions are of their last generation
  # statistics over replications
  population_std: bool = True            # of the interval, 1.96 std / sqrt(replications); else Student's t
  # reconstruction
  sampled_latents: bool = False          # of a variational tokenizer: drawn, not its mean
  poses_alone: bool = True               # joint errors of each frame by itself, heading 0
  # editing
  paste: bool = False                    # put the kept frames back as they came
  # long motions and timelines
  sequences: int = 64                    # of prompts, or timelines, at the most
  segments: int = 32                     # prompts of a sequence that is drawn from the test set
  transition_frames: int = 60
  timelines: str | None = None           # a file of them, or of sequences of prompts
  released_slips: bool = True            # Parity: of STMC's script, see `metrics.timeline_scores.Mtt`
  recorded: int = 0                      # at most this many prompts, from recordings with more motions than that
  joints_layout: str = ""                # where real joints are of other features than the evaluator's
  jerk_unit: float = 1.0                 # of jerk, in metres: 0.01 is centimetres
  real_jerk: str | None = "humanml3d"    # level of AUJ, a key of physics.REAL_JERK; None: of the real clips given
  way: str = "stream"                    # of long motions where --sampling does not say: "stream", "chain" or "joined"
  paper: tuple[str, str, str] | None = None  # (system, table, row) of the paper to compare with
  paper_layout: str | None = None        # where only an evaluator of this layout compares with it
  note: str = ""                         # what has to be said under the table

  def on(self, data_format):
    """The protocol for a data format: archives have shorter clips of up to 200 frames and shipped evaluators, and are
    not comparable with any paper.
    """
    if data_format != "archive":
      return self
    ships = "part-tmr-small" if "tmr" in self.kinds else "evaluator-small"
    changes = dict(evaluator=self.evaluator or ships, paper=None, population_std=False, note="")
    if self.task in ("generation", "reconstruction", "editing", "control"):
      changes |= dict(min_frames=min(self.min_frames, 24), past_frames=201,
                      clip_evaluator=self.clip_evaluator or "clip-evaluator-small")
    elif self.task == "long_horizon":  # the model's own way, and AUJ from the clips' own level
      changes |= dict(way="stream", real_jerk=None)
    return dataclasses.replace(self, **changes)

  def of_few(self, count):
    """The protocol for a small test set: fewer candidates per pool where custom data has fewer than 32 test clips."""
    if self.name != "own-66" or count >= self.pool:
      return self
    if count <= self.top_k:
      raise ValueError(f"got {count} test clips, protocol 'own-66' needs {self.top_k + 1} or more; give more "
                       "recordings, or name more of them test in the column `split` of captions.csv")
    return dataclasses.replace(self, pool=count, note=f"Only {count} test clips: R-precision is among {count}, not "
                                                      f"{self.pool}, by chance R@1 is {1 / count:.2f}")

  @property
  def num_multimodality(self) -> int:
    """Number of captions that are generated many times."""
    return self.multimodality_captions or self.multimodality_batches * self.pool

  def has_multimodality(self, replication) -> bool:
    """Whether a replication, counted from 0, generates some captions many times."""
    return self.num_multimodality > 0 and (
        self.multimodality_replications is None or replication < self.multimodality_replications)

  def without_multimodality(self):
    return dataclasses.replace(self, multimodality_captions=0, multimodality_batches=0)

_CMDM = Benchmark(
    name="cmdm-259", title="Text to motion, HumanML3D, 263 features", source="docs/papers/cmdm.md#items, #protocol",
    layouts=("full",), seed=3467, max_frames=192, lost_frames=1, replications=10,
    # Parity: generated motions are padded to the longest of their batch; with a frame lost no token reads that far.
    paper=("cmdm", "1", "CMDM w/ FSS"))

_CDAMD = Benchmark(
    name="cdamd-66", title="Text to motion, HumanML3D, joint coordinates",
    source="docs/papers/cdamd.md#items, #metrics", seed=3407, layouts=("coordinates",), lost_frames=0,
    replications=20, made_padding="decoded",
    # Parity: switched off in the released script; 96 captions of which the other scores see the last generation.
    multimodality_batches=3, multimodality_shared=True, paper=("cdamd", "1", "CDAMD (two VQ)"))

_OWN_SEQUENCES = ("Prompts in a row are drawn from the test items by the seed; the paper's are FlowMDM's list, which "
                  "--data takes as a .json file: without it compare rows of ours alone")
_RECORDINGS = ("What motions in a row are is our reading of \"over five continuous motions\": none overlaps, at most a "
               "second lies between two; the real side is the recordings themselves, R-precision is of one recording's "
               "own captions, jerk is in centimetres")
_CONTROLLED = ("Rows of a joint are the mean of 1, 2 and 5 controlled frames, a quarter of them and all; in the row "
               "\"unconstrained\" is the same model without constraints, and its distances are those of the pelvis")
_AUTHORS = "Printed rows are those of each method's own authors, whose draws and lengths differ a little"
_ANY_GENERATION = ("archive", "humanml3d")

PROTOCOLS = {protocol.name: protocol for protocol in (
    dataclasses.replace(
        _CDAMD, name="archives-66", title="Text to motion, CMU and Bandai archives, joint coordinates",
        source="our own benchmark: cdamd-66's rules on archives, clips from 24 rows; multimodality in 5 of 20 repeats",
        formats=("archive",), evaluator="evaluator-small", clip_evaluator="clip-evaluator-small",
        made_padding="zeros", multimodality_batches=1, multimodality_motions=20, multimodality_replications=5,
        multimodality_shared=False, paper=None),
    dataclasses.replace(
        _CDAMD, name="own-66", title="Text to motion, your own data, joint coordinates",
        source="archives-66 on a folder of `motion-jax data build`: numbers compare among your own models",
        formats=_ANY_GENERATION,
        min_frames=24, past_frames=201, population_std=False, replications=4, evaluator="evaluator-small",
        clip_evaluator="clip-evaluator-small", made_padding="zeros", multimodality_batches=1, multimodality_motions=20,
        multimodality_replications=1, multimodality_shared=False, paper=None),
    _CMDM,
    dataclasses.replace(
        _CMDM, name="cmdm-67", title="Text to motion, HumanML3D, 67 features", layouts=("essential",),
        paper=("cmdm", "6", "CMDM w/ FSS")),
    _CDAMD,
    Benchmark(
        name="t2m-263", title="Text to motion, HumanML3D, protocol of T2M", seed=3407, layouts=("full",),
        source="docs/papers/cmdm.md#evaluators, docs/papers/cdamd.md#items, #metrics (EricGuo5513/text-to-motion: no "
               "frame lost, 20 repeats, 100 captions)",
        lost_frames=0, replications=20, multimodality_captions=100, paper=("authors", "humanml3d", ""),
        note=_AUTHORS),
    dataclasses.replace(
        _CDAMD, name="kit", title="Text to motion, KIT", source="docs/papers/cdamd.md#items, #metrics", min_frames=24,
        layouts=("coordinates_kit", "essential_kit", "full_kit"), paper=("cdamd", "2", "CDAMD"),
        paper_layout="coordinates_kit"),
    Benchmark(
        name="snapmogen", title="Text to motion, SnapMoGen", source="docs/papers/cmdm.md#snapmogen",
        formats=("snapmogen",), layouts=("snapmogen_148", "snapmogen"), kinds=("snapmogen",), seed=3407, pool=100,
        lost_frames=0, replications=10, min_frames=128,
        # Parity: SnapMoGen repeats 20 times, the paper says 10; spans of any length, cut to 320.
        past_frames=10**9, max_frames=320, unit_length=8, coin=False, cosine=True, multimodality_batches=1,
        paper=("cmdm", "2", "CMDM w/ FSS")),
    Benchmark(
        name="long-horizon", title="Long motions, 32 prompts in a row", source="docs/papers/cmdm.md#long-horizon",
        task="long_horizon", formats=_ANY_GENERATION, seed=3407, lost_frames=0, replications=10, min_frames=70,
        past_frames=201, max_frames=200, coin=False,
        # Parity: segment by segment, as the code behind the published numbers (docs/papers/cmdm.md#multi-prompt).
        random_crop=False, way="chain", paper=("cmdm", "3-humanml3d", "CMDM"), paper_layout="full",
        note=_OWN_SEQUENCES),
    Benchmark(
        name="snapmogen-long", title="Long motions, SnapMoGen's recordings",
        source="docs/papers/cmdm.md#long-horizon, #snapmogen", task="long_horizon",
        formats=("snapmogen",), layouts=("snapmogen_148", "snapmogen"), kinds=("snapmogen",), seed=3407, lost_frames=0,
        replications=10, min_frames=60, past_frames=10**9, max_frames=320, coin=False, random_crop=False, cosine=True,
        # Parity: the printed AUJ fits HumanML3D's level in numbers of centimetres: that of real motions, 45.16 under a
        # peak of 1.11, is far from 0, and FlowMDM's, whose motions stand still, is lower.
        sequences=128, recorded=5, joints_layout="snapmogen", jerk_unit=0.01, way="chain",
        paper=("cmdm", "3-snapmogen", "CMDM"), note=_RECORDINGS),
    Benchmark(
        name="babel", title="Long motions, BABEL", source="docs/papers/cmdm.md#long-horizon", task="long_horizon",
        formats=("babel",), layouts=("babel",), kinds=("tmr", "t2m"), split="val", seed=3407, lost_frames=0,
        replications=10, min_frames=30, past_frames=201, max_frames=200, coin=False, random_crop=False,
        transition_frames=30, real_jerk="babel", way="chain", paper=("cmdm", "5", "CMDM"), note=_OWN_SEQUENCES),
    Benchmark(
        name="mtt", title="Timelines, MTT", source="docs/papers/cmdm.md#long-horizon", task="timelines",
        formats=_ANY_GENERATION, kinds=("tmr",), seed=3407, lost_frames=0, replications=1, max_frames=400,
        past_frames=401, sequences=10**9, paper=("cmdm", "7", "CMDM")),
    dataclasses.replace(
        _CDAMD, name="control", title="Control of joints, and paths that no clip has",
        source="docs/evaluation.md#control (neu-vi/OmniControl@76336a6: one repeat, the mean of five densities)",
        task="control", formats=_ANY_GENERATION, layouts=(), replications=1, multimodality_batches=0,
        paper=("control", "263-pelvis", "OmniControl"), note=_CONTROLLED),
    dataclasses.replace(
        _CDAMD, name="editing", title="Editing in time",
        source="docs/papers/cdamd.md#editing, #metrics; repeats: one in the released comment",
        task="editing", formats=_ANY_GENERATION, layouts=(), replications=1,
        paper=("cdamd", "3", "CDAMD"), paper_layout="coordinates"),
    dataclasses.replace(
        _CMDM, name="reconstruction", title="Reconstruction by the tokenizer",
        source="docs/papers/cmdm.md#reconstruction", task="reconstruction", formats=_ANY_GENERATION, layouts=(),
        sampled_latents=True, paper=("cmdm", "8", "MAC-VAE 64, 1/4"), paper_layout="full"),
)}


def get_protocol(name) -> Benchmark:
  """A protocol by name; a `Benchmark` is returned as it is. Raises ValueError for an unknown name."""
  if isinstance(name, Benchmark):
    return name
  if name not in PROTOCOLS:
    raise ValueError(f"got protocol {name!r}{did_you_mean(name, PROTOCOLS)}, expected one of {', '.join(PROTOCOLS)}")
  return PROTOCOLS[name]
