"""Evaluation by named protocols, beside the tables of the papers.

request     which models, data and protocol; `run` evaluates it
protocols   named protocols: how a test split becomes a row of numbers
tasks       what a protocol measures: generation, long motions, timelines, control, editing, reconstruction
checks      sanity checks of the evaluators, controls with damaged real motions
samples     generated motions and the folders that keep them; `external` reads those of other programs
result      results.json; `report` makes tables and pages of it
"""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.evaluation.protocols import PROTOCOLS, Benchmark, get_protocol
  from motion_jax.evaluation.request import Request
  from motion_jax.evaluation.result import Result
  from motion_jax.evaluation.run import evaluate, export_prompts

__all__ = ["PROTOCOLS", "Benchmark", "Request", "Result", "evaluate", "export_prompts", "get_protocol"]

__getattr__, __dir__ = lazy.attach(__name__)
