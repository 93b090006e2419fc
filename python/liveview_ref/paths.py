"""Places in the repository."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "models"
CONFIGS = ROOT / "python" / "configs"
BINARY = ROOT / "target" / "release" / "liveview"
