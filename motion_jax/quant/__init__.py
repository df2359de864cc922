"""Vector quantizers: latents to codes and back."""
