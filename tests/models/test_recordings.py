"""The further methods compute what their references did: each recorded run of tests/fixtures, a row of this matrix."""
from tests import fixtures
from tests.golden import check, recordings
from tests.models.mdm import runners as _mdm  # noqa: F401
from tests.models.mld import runners as _mld  # noqa: F401
from tests.models.momask import runners as _momask  # noqa: F401
from tests.models.motionstreamer import runners as _motionstreamer  # noqa: F401
from tests.models.t2m_gpt import runners as _t2m_gpt  # noqa: F401

ROWS = {
    "mdm": ("mdm_tables", "mdm_losses", "mdm_losses_geometric", "mdm_sample", "mdm_dip", "mdm_targets", "mdm_edit"),
    "mld": ("mld_tables", "mld_vae_loss", "mld_novae", "mld_sample", "mld_diffusion_loss"),
    "momask": ("rvq_eval", "rvq_train_step", "mask_transformer", "mask_corruption", "mask_train_step", "mask_generate",
               "residual_transformer", "residual_train_step", "residual_generate", "edit", "pipeline", "schedules",
               "statistics"),
    "motionstreamer": ("ms_tae", "ms_tae_loss", "ms_two_forward", "ms_generate", "ms_stream"),
    "t2m_gpt": ("vq_eval", "vq_train_step", "quantizer_train", "gpt", "gpt_train", "gpt_sample", "pipeline",
                "token_items")}
SINGLE = ("mdm/mdm_edit", "momask/mask_corruption", "momask/edit", "t2m_gpt/token_items")
QUICK = ("mdm/mdm_tables", "mdm/mdm_losses_geometric", "mdm/mdm_edit", "mld/mld_tables", "momask/mask_corruption",
         "momask/schedules", "momask/statistics", "t2m_gpt/vq_train_step", "t2m_gpt/token_items")
# Parts of what larger ones compute, or sequences of what smaller ones compute.
RARE = ("momask/rvq_eval", "momask/mask_transformer", "momask/residual_transformer", "momask/pipeline",
        "motionstreamer/ms_tae", "motionstreamer/ms_stream", "t2m_gpt/vq_eval", "t2m_gpt/gpt", "t2m_gpt/pipeline")
NAMES = [f"{method}/{name}" for method, names in ROWS.items() for name in names]


@recordings(*NAMES, single=SINGLE, slow=[name for name in NAMES if name not in QUICK], rare=RARE)
def test_what_is_computed_is_what_was_recorded(name, precision):
  assert not check(fixtures.path(f"{name}.npz"), [precision]).failures
