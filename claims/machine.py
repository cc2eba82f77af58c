"""What a figure was measured on, and when."""

import os
import platform
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import palpate

PACKAGES = ("numpy", "numba", "scipy", "trimesh", "embreex")


def machine() -> list[str]:
    """Date, processor, versions and how busy it was, a line each."""
    now = datetime.now(UTC)
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    versions = ", ".join(f"{name} {_version(name)}" for name in PACKAGES)
    return [
        f"{now:%Y-%m-%d %H:%M} UTC",
        f"palpate {palpate.__version__}, Python {platform.python_version()}, {versions}",
        f"{_processor()}, {cores} cores, load {load:.1f}; {platform.system()} {platform.machine()}",
    ]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or "unknown processor"
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown processor")
