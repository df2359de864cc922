"""Networks as linen modules: arrays in, arrays out; no losses, no schedules."""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
