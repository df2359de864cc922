"""Text encoders, from captions to embeddings of words or sentences, and the vocabulary of captions."""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
