"""Skeletons of other programs: their joint names, trees and rest poses, and the maps to HumanML3D's 22 joints."""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
