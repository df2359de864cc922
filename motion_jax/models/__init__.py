"""Methods, a folder each with the same files in it, and what they share.

losses    of its networks                          sampling  from noise or codes to latents or features, pure
stages    what is trained, as pure functions       model     ready to use; options: its choices of sampling
setup     a config becomes a stage with its data   weights   the authors' PyTorch files; weight_names: their names
"""
import lazy_loader

__getattr__, __dir__, _ = lazy_loader.attach(__name__, ["cdamd", "cmdm", "mdm", "mld", "momask", "motionstreamer",
                                                        "t2m_gpt", "tmr"])
