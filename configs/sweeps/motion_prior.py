"""CDAMD with and without its conditional motion prior: the two runs of the paper's Fig. 7, validation loss by step.

  python benchmarks/sweep.py motion_prior --workdir runs/fig7 --data HumanML3D --config.frozen.text=CLIP-FOLDER
  python benchmarks/sweep.py motion_prior:mini --workdir runs/fig7 --data path/to/cmu path/to/bandai

Sizes: full, small, mini, tiny. At all but tiny the autoencoder and the RVQ-VAE of ablations/cdamd:default are trained
first, in runs/ablations/default/autoencoder and runs/ablations/default/rvq. runs/fig7/sweep.png is the figure: a curve
a run, a panel a number. held_out_with_prior is the reference's validation loss, in which the network is given the codes
of what it makes; held_out_loss is that without, as motion is made. The paper does not say which one it draws.

Expected: nothing has been run but `tiny`, by the tests.
"""


def get_sweep(size="full"):
  return {"with-prior": (f"ablations/cdamd:default/generator/{size}", {}),
          "without-prior": (f"ablations/cdamd:no-prior/generator/{size}", {})}
