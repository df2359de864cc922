from .protocols import PROTOCOLS, Benchmark, get_protocol
from .request import Request
from .result import Result
from .run import evaluate, export_prompts

__all__ = ["PROTOCOLS", "Benchmark", "Request", "Result", "evaluate", "export_prompts", "get_protocol"]
