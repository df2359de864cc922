"""motion_jax: make people move from words."""
__version__ = "0.1.0"
