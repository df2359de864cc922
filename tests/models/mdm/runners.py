"""MDM's tables, losses, sampling, edits and DiP, computed as recorded (`tests.models.test_recordings`)."""
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.diffusion import ddpm
from motion_jax.models.mdm import editing, goals, losses, sampling
from motion_jax.motion.representations import layout_for
from motion_jax.nets.masks import padding_mask
from tests.golden import golden, loss_and_grads
from tests.nets.test_motion_denoiser import motion, network, theirs, words

SCHEDULES = {"cosine": ddpm.cosine_schedule, "linear": ddpm.linear_schedule}
TABLES = ("betas", "alphas_cumprod", "posterior_variance", "posterior_log_variance_clipped", "posterior_mean_coef1",
          "posterior_mean_coef2")


@golden("mdm_tables", bounds={"log": (1e-9, 1e-9), "timestep_map": (0, 0), "": (1e-4, 1e-9)})
def run_mdm_tables(fixture, dtype):
  made = {}
  for name, (kind, num_steps, spacing) in fixture.sizes["schedules"].items():
    schedule = SCHEDULES[kind](num_steps)
    schedule = ddpm.respace(schedule, spacing) if spacing else schedule
    made |= {f"{name}/{table}": getattr(schedule, table) for table in TABLES}
    made[f"{name}/timestep_map"] = schedule.steps
    for table in TABLES:  # closer than the bound of what is computed from them
      np.testing.assert_allclose(made[f"{name}/{table}"], fixture[f"out/{name}/{table}"], rtol=1e-9, atol=1e-12)
    if f"in/{name}/x0" not in fixture.arrays:
      continue
    x0, noise, found = (motion(fixture[f"in/{name}/{part}"], dtype) for part in ("x0", "noise", "prediction"))
    t = jnp.asarray(fixture[f"in/{name}/t"])[:, None]
    x = ddpm.add_noise(schedule, x0, noise, t)
    made |= {f"{name}/q_sample": theirs(x, 5), f"{name}/posterior_mean": theirs(
        ddpm.posterior_mean(schedule, x, found, t), 5),
             f"{name}/noise_from_x0": theirs(ddpm.noise_of_x1(schedule, x, x0, t), 5),
             f"{name}/posterior_log_variance": schedule.posterior_log_variance_clipped[np.asarray(t)[:, 0]]}
    joints = fixture[f"in/{name}/x0"].shape[1]
    made |= {key: value.reshape(len(value), joints, -1, value.shape[-1]) for key, value in made.items()
             if key.startswith(f"{name}/") and value.ndim == 4}
  return made


def noisy_batch(fixture, dtype):
  """-> (clean features, which frames are real, noise(schedule) -> noisy features, their steps) of a training step."""
  x0, noise, t = motion(fixture["in/x0"], dtype), motion(fixture["in/noise"], dtype), jnp.asarray(fixture["in/t"])
  real = padding_mask(jnp.asarray(fixture["in/lengths"]), x0.shape[1])
  return x0, real, ddpm.add_noise(ddpm.cosine_schedule(fixture.sizes.get("diffusion_steps", 1000)), x0, noise,
                                  t[:, None]), t


@golden("mdm_losses", bounds={"": (1e-5, 1e-10)})
def run_mdm_losses(fixture, dtype):
  net, params, table = network(fixture, dtype)
  sizes, (x0, real, x, t) = fixture.sizes, noisy_batch(fixture, dtype)
  dropped = jnp.asarray(fixture["in/drop_u"]) < fixture.stated(r"drop_u < ([\d.]+)")
  text = jnp.where(dropped[:, None, None], 0, words(fixture, dtype)[0])

  def loss(params):
    made = net.apply(params, x, t, text, frame_mask=real if sizes["mask_frames"] else None)
    terms = losses.mdm_terms(made, x0, real, {"velocity": sizes["lambda_vel"]})
    return terms["loss"].mean(), (made, terms)

  value, (made, terms), grads = loss_and_grads(loss, params, table)
  return {"prediction": theirs(made), "rot_mse": terms["features"], "vel_mse": terms["velocity"],
          "loss": terms["loss"], "mean_loss": value} | grads


@golden("mdm_losses_geometric", bounds={"": (1e-5, 1e-10)})
def run_mdm_losses_geometric(fixture, dtype):
  net, params, table = network(fixture, dtype)
  sizes, (x0, real, x, t) = fixture.sizes, noisy_batch(fixture, dtype)
  action = jax.nn.one_hot(jnp.asarray(fixture["in/action"]), net.text_dim, dtype=dtype)
  kinematics = jnp.asarray(fixture["in/kinematics"], dtype)
  joints_of = lambda x: (x @ kinematics.T).reshape(*x.shape[:2], -1, 3)
  weights = dict(zip(("velocity", "positions", "contacts"), sizes["lambda_vel_rcxyz_fc"]))

  def loss(params):
    made = net.apply(params, x, t, action)
    terms = losses.mdm_terms(made, x0, real, weights, sizes["nfeats"], (joints_of(made), joints_of(x0)),
                             (7, 10, 8, 11))
    return terms["loss"].mean(), (made, terms)

  value, (made, terms), grads = loss_and_grads(loss, params, table)
  del grads["grad/embed_text.bias"]
  grads["grad/embed_action.action_embedding"] = grads.pop("grad/embed_text.weight").T
  return {"prediction": theirs(made, fixture["in/x0"].shape[1]), "rot_mse": terms["features"],
          "vel_mse": terms["velocity"], "rcxyz_mse": terms["positions"], "fc": terms["contacts"],
          "loss": terms["loss"], "mean_loss": value} | grads


@golden("mdm_sample", bounds={"": (3e-5, 1e-10)})
def run_mdm_sample(fixture, dtype):
  net, params, _ = network(fixture, dtype)
  sizes, scale, (text, _) = fixture.sizes, jnp.asarray(fixture["in/scale"], dtype), words(fixture, dtype)
  made = {}
  for name, (kind, num_steps, spacing) in sizes["schedules"].items():
    assert kind == "cosine"
    noise = motion(fixture[f"in/{name}/noise"], dtype)
    real = padding_mask(jnp.asarray(fixture["in/lengths"]), noise.shape[2]) if sizes["mask_frames"] else None
    plan = sampling.Plan(num_steps, spacing or num_steps)
    condition = sampling.Condition(text, frame_mask=real)
    predict = sampling.predictor(net, plan, params, condition, scale)
    path = jax.jit(lambda noise, plan=plan, predict=predict: ddpm.ancestral_path(
        predict, sampling.schedule_of(plan), noise[0], lambda m: noise[m + 1], predicts="x1"))(noise)
    run = jax.jit(sampling.denoise, static_argnums=(0, 1, 5))
    sample = run(net, plan, params, condition, scale, Draw(noise))
    made |= {f"{name}/path": theirs(path[jnp.array(sizes["kept_steps"])]), f"{name}/sample": theirs(sample)}
    if f"out/{name}/ddim" in fixture.arrays:
      made[f"{name}/ddim"] = theirs(run(net, plan._replace(solver="ddim"), params, condition, scale, Draw(noise)))
  return made


class Draw:
  """Recorded noise (N + 1, B, T, F) as `sampling.denoise` draws it; with blocks (K, N + 1, B, T, F) also by block."""

  def __init__(self, noise):
    self.noise = noise

  def __call__(self, *place):
    return self.noise[place]


@golden("mdm_edit", bounds={**{name: (0, 0) for name in (
    "in_between/mask", "upper_body/mask", "lower_body_mask", "upper_body_mask", "root_mask", "root_horizontal_mask",
    "in_between_range")}, "": (3e-5, 1e-10)})
def run_mdm_edit(fixture, dtype):
  net, params, _ = network(fixture, dtype)
  sizes, noise, (text, _) = fixture.sizes, motion(fixture["in/noise"], dtype), words(fixture, dtype)
  known, lengths = motion(fixture["in/motion"], dtype), fixture["in/lengths"]
  layout, length = layout_for(known.shape[-1]), known.shape[1]
  kept = editing.kept_columns(layout, "upper_body")
  path = editing.path_columns(layout)
  gaps = [editing.gap(count, sizes["prefix_end"], sizes["suffix_start"]) for count in lengths]
  new = np.stack([(np.arange(length) >= first) & (np.arange(length) < past) for first, past in gaps])
  masks = {"in_between": np.broadcast_to(~new[..., None], known.shape),
           "upper_body": np.broadcast_to(kept, known.shape)}
  root = path | editing.joint_columns(layout, (0,), contacts=False)
  made = {"lower_body_mask": kept, "upper_body_mask": ~kept, "root_mask": root,
          "root_horizontal_mask": np.arange(layout.dim) < 3,
          "in_between_range": np.array([editing.gap(count) for count in range(
              1, len(fixture["out/in_between_range"]) + 1)])}
  plan = sampling.Plan(sizes["diffusion_steps"], sizes["diffusion_steps"])
  run = jax.jit(lambda mask, scale: sampling.denoise(
      net, plan, params, sampling.Condition(text), scale, lambda m: noise[m], known, mask))
  for name, mask in masks.items():
    made[f"{name}/mask"] = mask.swapaxes(1, 2)
    for kind, scale in (("text", sizes["scale"]), ("free", 0.0)):
      out = run(mask, scale)
      np.testing.assert_array_equal(np.asarray(out)[mask], np.asarray(known)[mask])
      made[f"{name}/{kind}"] = theirs(out)
  return made


@golden("mdm_dip", bounds={"generated": (1e-3, 1e-10), "": (2e-5, 1e-10)})
def run_mdm_dip(fixture, dtype):
  net, params, _ = network(fixture, dtype, "decoder")
  x, prefix, t = motion(fixture["in/x"], dtype), motion(fixture["in/prefix"], dtype), jnp.asarray(fixture["in/t"])
  lengths = fixture.meta["texts"]
  sizes, row = fixture.sizes, {name: i for i, name in enumerate(fixture.sizes["order_of_words"])}
  real = jnp.ones(x.shape[:2], bool)

  def text_of(*names):
    """Words are padded to the longest of a call."""
    count = max(lengths[name] for name in names)
    mask = jnp.array([[i < lengths[name] for i in range(count)] for name in names])
    return jnp.stack([jnp.asarray(fixture["in/words"], dtype)[row[name], :count] for name in names]), mask

  counts = counted_goals(fixture)
  given = goals.conditions(jnp.asarray(fixture["in/target"], dtype), counts)  # unused ones are not 0 in the recording
  text, mask = text_of(*sizes["sentence"])
  forward = jax.jit(lambda text, goals: net.apply(params, x, t, text, mask, real, prefix, goals))
  made = {"plain": forward(text, None), "uncond": forward(0 * text, None), "target": forward(text, given),
          "target_free": forward(text, None)}
  noise, plan = motion(fixture["in/noise"], dtype), sampling.Plan(sizes["diffusion_steps"], sizes["diffusion_steps"])
  num_blocks, frames = len(noise), fixture["out/generated"].shape[-1]
  same = [text_of(*sizes["sentence"])] * num_blocks
  changing = [text_of(*names) for names in zip(*sizes["changing"])]  # a row has a text for each prediction

  @jax.jit
  def block(prefix, text, mask, noise):
    condition = sampling.Condition(text, mask, jnp.ones(noise.shape[1:3], bool), prefix)
    return sampling.next_block(net, plan, params, condition, sizes["scale"], lambda m: noise[m])

  def run(texts):
    last, blocks = prefix, []
    for (text, mask), noise_of_block in zip(texts, noise):
      made, last = block(last, text, mask, noise_of_block)
      blocks.append(made)
    return jnp.concatenate(blocks, axis=1)

  made["generated"] = run(same)[:, :frames]
  whole = jnp.concatenate([prefix, run(changing)], axis=1)
  made["generated_changing"] = whole[:, :frames]
  return {name: theirs(value) for name, value in made.items()} | {
      "target_embedding": net.apply(params, given, method="goal")}


def counted_goals(fixture):
  used = zip(fixture.meta["goals_used"], fixture.meta["heading_used"])
  return goals.goal_mask([["path" if goal == "traj" else goal for goal in [*goals_used, *["heading"] * heading]]
                          for goals_used, heading in used])


@golden("mdm_targets", bounds={"": (1e-5, 1e-9)})
def run_mdm_targets(fixture, dtype):
  mean, std = (jnp.asarray(fixture[f"in/{name}"], dtype).reshape(-1) for name in ("mean", "std"))
  layout = layout_for(fixture["in/motion"].shape[1])
  found = {name: goals.places(layout.to_joints(motion(fixture[f"in/{name}"], dtype) * std + mean), layout)
           for name in ("motion", "prediction")}
  counts = counted_goals(fixture)
  given = {name: jnp.where(counts[..., None], rows, 0) for name, rows in found.items()}
  return {"location": given["motion"], "location_of_prediction": given["prediction"],
          "loss": goals.goal_error(found["prediction"], found["motion"], counts)}
