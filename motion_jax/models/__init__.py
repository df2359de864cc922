"""Methods, a folder each with the same files in it, and what they share."""
import lazy_loader

__getattr__, __dir__, _ = lazy_loader.attach(__name__, ["cdamd", "cmdm", "mdm", "mld", "momask", "motionstreamer",
                                                        "t2m_gpt", "tmr"])
