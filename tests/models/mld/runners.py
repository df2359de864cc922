"""MLD's tables, losses and samplers, computed as recorded (`tests.models.test_recordings`)."""
import re

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.diffusion import ddpm
from motion_jax.models.mld import losses, sampling
from motion_jax.motion.representations import layout_for
from motion_jax.nets.masks import padding_mask
from tests.golden import golden, loss_and_grads
from tests.nets.test_latent_diffusion import denoiser, vae


@golden("mld_tables", bounds={"timesteps": (0, 0), "ddim": (5e-6, 1e-10), "ddpm": (5e-6, 1e-10),
                              "add_noise": (5e-6, 1e-10), "": (1e-6, 1e-10)})
def run_mld_tables(fixture, dtype):
  sample, prediction, noise = fixture.inputs(dtype, "sample", "prediction", "noise")
  whole = ddpm.scaled_linear_schedule()
  made = {"betas": whole.betas, "alphas_cumprod": whole.alphas_cumprod,
          "add_noise": ddpm.add_noise(whole, sample, noise, jnp.asarray(fixture["in/t"])[:, None])}
  for name in fixture.under("out/"):
    kind, count = (name.split("/")[0][:4], name.split("/")[0][4:]) if "/" in name else ("", "")
    if kind not in ("ddim", "ddpm"):
      continue
    plan = sampling.Plan(num_steps=int(count), solver="ddim" if kind == "ddim" else "ancestral")
    schedule = sampling.schedule_of(plan)
    if name.endswith("timesteps"):
      made[name] = schedule.steps[::-1]
    elif kind == "ddim":
      chosen = map(int, re.findall(r"\d+", fixture.meta["arrays"][f"out/{name}"]["what"]))  # "for t = 981, 501, ..."
      rows = [int(np.flatnonzero(schedule.steps == t)[0]) for t in chosen]
      made[name] = jnp.stack([ddim_step(schedule, sample, prediction, row, whole.alphas_cumprod[0]) for row in rows])
    else:
      last = len(schedule.steps) - 1
      clean = lambda row, schedule=schedule: ddpm.x1_of_noise(schedule, sample, prediction, row)
      made[name] = jnp.stack([ddpm.step_back(schedule, sample, clean(row), row, noise)
                              for row in (last, last - len(schedule.steps) // 2, 0)])
  return made


def ddim_step(schedule, sample, prediction, row, end):
  """The step of one row of a DDIM's table: the last step of a table that begins there."""
  before = schedule.alphas_cumprod[row - 1] if row else end
  alone = ddpm.at_steps(schedule, np.array([row]))
  return ddpm.ddim(lambda x, t: prediction, alone, sample, float(before))


@golden("mld_vae_loss", bounds={"": (1e-5, 1e-10)})
def run_mld_vae_loss(fixture, dtype):
  net, params, table = vae(fixture, dtype)
  sizes = fixture.sizes
  weights = {"features": sizes["lambda_rec"], "joints": sizes["lambda_joint"], "kl": sizes["lambda_kl"]}
  x, noise, mean, std = fixture.inputs(dtype, "motion", "eps", "mean", "std")
  real, layout = padding_mask(jnp.asarray(fixture["in/lengths"]), x.shape[1]), layout_for(x.shape[-1])

  def loss(params):
    made, *gaussian = net.apply(params, x, noise.swapaxes(0, 1), real)
    joints = layout.to_joints(made * std + mean), layout.to_joints(x * std + mean)
    terms = losses.vae_terms(made, x, joints, *gaussian, weights)
    return terms["loss"].mean(), (made, joints[0], terms)

  _, (made, joints, terms), grads = loss_and_grads(loss, params, table)
  terms = {name: value.mean() for name, value in terms.items()}
  return {"reconstruction": made, "joints": joints, "recons_feature": terms["features"],
          "recons_joints": terms["joints"], "kl_motion": terms["kl"], "total": terms["loss"]} | grads


@golden("mld_novae", bounds={"predicted": (3e-5, 1e-10), "": (1e-5, 1e-10)})
def run_mld_novae(fixture, dtype):
  net, params, _ = denoiser(fixture, dtype)
  x, text, noise = fixture.inputs(dtype, "x", "text", "noise")
  real = padding_mask(jnp.asarray(fixture["in/lengths"]), x.shape[1])
  without, words = jnp.split(text, 2)
  sizes = fixture.sizes
  plan = sampling.Plan(num_steps=sizes["steps"], solver="ancestral")
  masked = sampling.FrameDenoiser(net, real, hidden=False)
  noise = jnp.concatenate([noise, jnp.zeros_like(noise[:1])])  # none is drawn for the last step
  sampled = jax.jit(lambda words, without: sampling.denoise(masked, plan, params, words, without, sizes["guidance"],
                                                            lambda m: noise[m]))(words, without)
  predicted = jax.jit(lambda x: net.apply(params, x, jnp.asarray(fixture["in/t"]), words))(x)
  return {"predicted": jnp.where(real[..., None], predicted, 0), "sampled": sampled}


@golden("mld_sample", bounds={"": (1e-5, 1e-10)})
def run_mld_sample(fixture, dtype):
  net, params, _ = denoiser(fixture, dtype, "denoiser.")
  decoder, vae_params, _ = vae(fixture, dtype, "vae.")
  without, words = jnp.split(jnp.asarray(fixture["in/text"], dtype), 2)
  lengths = fixture["in/lengths"]
  real, sizes = padding_mask(jnp.asarray(lengths), int(lengths.max())), fixture.sizes
  start, made = jnp.asarray(fixture["in/start"], dtype), {}
  for prefix, predicts in (("", "noise"), ("x0/", "x1")):
    plan = sampling.Plan(num_steps=sizes["steps"], predicts=predicts)

    @jax.jit
    def run(start, plan=plan):
      predict = sampling.predictor(net, plan, params, words, without, sizes["guidance"])
      path = ddpm.ddim_path(predict, sampling.schedule_of(plan), start,
                            ddpm.scaled_linear_schedule().alphas_cumprod[0], plan.predicts)
      z = sampling.denoise(net, plan, params, words, without, sizes["guidance"], lambda m: start)
      return path, z, decoder.apply(vae_params, z, real, method="decode")

    path, z, motion = run(start)
    made |= {f"{prefix}path": path[jnp.array(sizes["kept_steps"])], f"{prefix}z": z.swapaxes(0, 1),
             f"{prefix}motion": motion}
  return made


# The reference's sinusoids of steps up to 999 are rounded in float32, which the time layer's gradient shows.
@golden("mld_diffusion_loss", bounds={"grad/time_embedding": (1e-4, 1e-9), "grad/": (1e-5, 1e-9), "": (1e-5, 1e-10)})
def run_mld_diffusion_loss(fixture, dtype):
  net, params, table = denoiser(fixture, dtype, "denoiser.")
  encoder, vae_params, _ = vae(fixture, dtype, "vae.")
  x, noise, text, eps, t = fixture.inputs(dtype, "motion", "noise", "text", "eps", "t")
  real = padding_mask(jnp.asarray(fixture["in/lengths"]), x.shape[1])
  drop_u = np.array([fixture[f"in/drop_u{i}"][0] for i in range(len(x))])
  dropped = drop_u < fixture.sizes["guidance_uncondp"]
  text = jnp.where(dropped[:, None, None], text[-1:], text[:-1])
  mean, logvar = jax.jit(lambda x: encoder.apply(vae_params, x, real, method="encode"))(x)
  z = mean + jnp.sqrt(jnp.exp(logvar)) * eps.swapaxes(0, 1)
  noisy = ddpm.add_noise(ddpm.scaled_linear_schedule(), z, noise, t[:, None])

  def loss(params):
    made = net.apply(params, noisy, t, text)
    return losses.prediction_error(made, noise).mean(), made

  value, made, grads = loss_and_grads(loss, params, table)
  return {"loss": value, "predicted_noise": made} | grads
