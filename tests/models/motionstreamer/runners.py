"""MotionStreamer's autoencoder, training and generation, computed as recorded (`tests.models.test_recordings`)."""
import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.convert.state import from_torch
from motion_jax.diffusion import ddpm
from motion_jax.models.motionstreamer import losses, sampling
from motion_jax.models.motionstreamer.weight_names import autoencoder_names
from motion_jax.nets.causal_vae import CausalVAE, sample_latent
from motion_jax.nets.masks import padding_mask
from tests.golden import golden, loss_and_grads
from tests.nets.test_latent_llama import generator, scales, state_of


def autoencoder(fixture, dtype, prefix=""):
  """-> (net, params, table) of a recorded causal autoencoder."""
  state, sizes = state_of(fixture, prefix), fixture.sizes
  width, latent_dim = state["tae.decode_proj.weight"].shape
  growth, depth, halvings = (sizes.get(name, usual) for name, usual in (
      ("dilation_growth_rate", 3), ("depth", 3), ("down_t", 2)))
  table = autoencoder_names(halvings, depth)
  net = CausalVAE(state["tae.encoder.model.0.conv.weight"].shape[1], latent_dim, width, halvings,
                  tuple(growth ** i for i in reversed(range(depth))), dtype=dtype)
  return net, jax.tree.map(lambda a: jnp.asarray(a, dtype), from_torch(state, table)), table


@golden("ms_tae", bounds={"": (1e-5, 1e-10)})
def run_ms_tae(fixture, dtype):
  net, params, _ = autoencoder(fixture, dtype)
  encode = jax.jit(lambda x: net.apply(params, x, method="encode"))
  decode = jax.jit(lambda z: net.apply(params, z, method="decode"))
  made = {}
  for i in sorted(int(name.removeprefix("motion")) for name in fixture.under("in/") if name.startswith("motion")):
    x, noise = fixture.inputs(dtype, f"motion{i}", f"eps{i}")
    mean, logvar = encode(x)
    z = sample_latent(mean, logvar, noise)
    made |= {f"mu{i}": mean, f"logvar{i}": logvar, f"z{i}": z, f"decoded{i}": decode(z)}
  latents, frames = fixture["out/first_latents"].shape[1], fixture["out/first_frames"].shape[1]
  made["first_frames"] = decode(made["z0"][:, :frames // net.frames_per_latent])
  made["first_latents"] = encode(fixture.inputs(dtype, "motion0")[:, :latents * net.frames_per_latent])[0]
  return made


@golden("ms_tae_loss", bounds={"grad/": (1e-5, 1e-9), "": (1e-6, 1e-10)})
def run_ms_tae_loss(fixture, dtype):
  net, params, table = autoencoder(fixture, dtype)
  x, noise = fixture.inputs(dtype, "motion", "eps")
  weights = {"kl": 1.0, "root": fixture.sizes["root_loss"]}

  def loss(params):
    terms = losses.autoencoder_terms(net, params, x, noise, weights, slice(0, 8))
    return terms["loss"], terms

  _, terms, grads = loss_and_grads(loss, params, table)
  decoded = jax.jit(lambda x: net.apply(params, x, noise)[0])(x)
  return {"decoded": decoded, "reconstruction": terms["rec"], "kl": terms["kl"], "root": terms["root"],
          "total": terms["loss"]} | grads


@golden("ms_two_forward", bounds={"replaced_counts": (0, 0), "plain/grad": (1e-5, 1e-9), "streaming/grad": (1e-5, 1e-9),
                                  "": (1e-5, 1e-10)})
def run_ms_two_forward(fixture, dtype):
  net, params, table = generator(fixture, dtype)
  sizes = fixture.sizes
  latents, text = fixture.inputs(dtype, "latents", "text")
  length, copies = latents.shape[1], sizes["diffmlps_batch_mul"]
  real = np.asarray(padding_mask(jnp.asarray(fixture["in/lengths"]), length))
  given = np.arange(length) < fixture["in/given"][:, None]
  schedule = ddpm.cosine_schedule(50)
  count = int(losses.num_replaced(sizes["step"], sizes["total_steps"], length))
  counts = len(fixture["out/replaced_counts"]) - 1
  made = {"replaced_counts": losses.num_replaced(np.arange(counts + 1), counts, int(
      fixture.stated(r"positions of (\d+)", "out/replaced_counts"))), **scales(net)}
  for name, kept in (("plain", np.zeros_like(given)), ("streaming", given)):
    part = fixture.under(f"in/{name}/")
    trained = real & ~kept
    replaced = np.isin(np.arange(length), part["perm"][:count]) & ~kept
    t, noise = np.zeros((copies, *real.shape), int), np.zeros((copies, *latents.shape), dtype)
    places = np.broadcast_to(trained, t.shape)
    t[places], noise[places] = part["t2"], part["noise2"]
    draws = losses.Draws(jnp.asarray(part["t1"]).reshape(real.shape),
                         jnp.asarray(part["noise1"], dtype).reshape(latents.shape), jnp.asarray(t), jnp.asarray(noise))

    def loss(params, trained=trained, replaced=replaced, draws=draws):
      sums, weight = losses.two_forward_loss(net, params, schedule, text, latents, jnp.asarray(trained),
                                             jnp.asarray(replaced), draws)
      return sums["loss"] / weight, None

    made[f"{name}/loss"], _, grads = loss_and_grads(loss, params, table)
    made |= {f"{name}/{key}": array for key, array in grads.items() if not key.endswith("attn.scale")}
  return made


def recorded_draw(start, steps):
  """draw(k, m) of start (K, B, C) and steps (K, N, 2 B, C), of which the second half has no meaning."""
  both = jnp.concatenate([start[:, None], steps[:, :, :start.shape[1]]], axis=1)
  return lambda k, m: both[k, m]


@golden("ms_generate", bounds={"motion": (1e-3, 1e-8), "": (1e-5, 1e-9)})
def run_ms_generate(fixture, dtype):
  net, params, _ = generator(fixture, dtype, "trans.")
  decoder, decoder_params, _ = autoencoder(fixture, dtype, "net.")
  sizes = fixture.sizes
  text, start, steps, end = fixture.inputs(dtype, "text", "start", "steps", "reference_end")
  draw, none = recorded_draw(start, steps), jnp.zeros((start.shape[1], 0, start.shape[-1]), dtype)

  def run(plan, scale, stop=None):
    def whole(text):
      segment = sampling.begin(net, plan, params, *jnp.split(text, 2), none, 0)  # with their captions, and with none
      return sampling.sample_segment(net, plan, params, segment, scale, draw, len(start), stop)[:2]

    return jax.jit(whole)(text)

  plan = sampling.Plan()
  tokens, _ = run(plan, sizes["guidance"])
  stopped, counts = run(plan, sizes["guidance"], sampling.Stop(end[0], sizes["threshold"]))
  stopped = stopped[:, :int(counts[0])]
  return {"tokens": tokens, "tokens_unguided": run(plan._replace(guided=False), 1.0)[0],
          "distances": jnp.linalg.norm(tokens[0] - end, axis=-1), "stopped": stopped,
          "motion": decoder.apply(decoder_params, stopped, method="decode"), **scales(net, "trans.")}


@golden("ms_stream", bounds={"whole": (1e-3, 1e-8), "": (1e-5, 1e-9)})
def run_ms_stream(fixture, dtype):
  net, params, _ = generator(fixture, dtype, "trans.")
  decoder, decoder_params, _ = autoencoder(fixture, dtype, "net.")
  sizes = fixture.sizes
  text, given, start, steps, end, early = fixture.inputs(dtype, "text", "given", "start", "steps", "reference_end",
                                                         "reference_early")
  plan, empty = sampling.Plan(), text[2:]

  def run(text, past, i, stop=None):
    def whole(text, past):
      segment = sampling.begin(net, plan, params, text, empty, past, past.shape[1])
      return sampling.sample_segment(net, plan, params, segment, sizes["guidance"], recorded_draw(start[i], steps[i]),
                                     start.shape[1], stop)[:2]

    made, counts = jax.jit(whole)(text, past)
    return made[:, :int(counts[0])]

  stop = lambda latent: sampling.Stop(latent[0], sizes["threshold"], 11)
  made = {"segment1_free": run(text[:1], given[None], 0), "segment1": run(text[:1], given[None], 0, stop(end))}
  free = run(text[:1], given[None], 0, stop(early))
  np.testing.assert_array_equal(free, made["segment1_free"])  # an end before the twelfth latent counts for nothing
  made["segment2"] = run(text[1:2], made["segment1"], 1)
  whole = jnp.concatenate([given[None], made["segment1"], made["segment2"]], axis=1)
  made["whole"] = decoder.apply(decoder_params, whole, method="decode")[:, ::sizes["every"]]
  return made | scales(net, "trans.")
