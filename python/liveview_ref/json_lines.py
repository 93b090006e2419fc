"""Programs driven by another one: a JSON object per line on stdin, one per line on stdout."""

import json
import os
import sys
from collections.abc import Callable
from typing import TextIO


def run(serve: Callable[[TextIO, TextIO], None]) -> int:
    """Let `serve(requests, replies)` answer the requests on stdin. A failure is answered by
    {"error": ...} and gives the exit code 2, else 0. Other output goes to stderr."""
    replies = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    try:
        serve(sys.stdin, replies)
    except Exception as error:
        print(json.dumps({"error": f"{type(error).__name__}: {error}"}), file=replies, flush=True)
        return 2
    return 0
