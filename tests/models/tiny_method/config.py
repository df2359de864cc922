"""The tiny method on procedural motions: what a file in configs/ is to a method of the package."""
import ml_collections


def get_config():
  config = ml_collections.ConfigDict()
  config.stage = "tiny.regressor"
  config.seed = 0
  config.frozen = dict(text="random-init", text_level="sentence")
  config.model = dict(features=263, text_dim=32, num_waves=4)
  config.loss = dict(drop_rate=0.1)
  config.data = dict(name="synthetic", layout="full", mode="corrected", mirror=False, batch_size=4, min_frames=20,
                     max_frames=64, lengths=(64,))
  config.optimizer = dict(learning_rate=1e-2, schedule="constant", warmup_steps=0, beta1=0.9, beta2=0.99,
                          weight_decay=0.0, clip_norm=0.0, ema_decay=0.0, skip_loss=0.0)
  config.mesh = dict(map="auto")
  config.sampler = dict(guidance_scale=2.0, spread=0.1)
  config.train = dict(start="", num_steps=2, log_every=1, save_every=2, best="")
  return config.lock()
