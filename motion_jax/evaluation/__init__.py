"""Evaluation by named protocols, compared with the tables of the papers.

request     which models, data and protocol; `run` evaluates it
protocols   named protocols: how a test split becomes a row of numbers
tasks       what a protocol measures: generation, long motions, timelines, control, editing, reconstruction
checks      sanity checks of the evaluators, controls with damaged real motions
samples     generated motions and the folders that keep them; `external` reads those of other programs
result      results.json; `report` makes tables and pages of it
"""
import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
