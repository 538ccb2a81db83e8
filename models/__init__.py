"""Robot, hook and mug models, and the weights that ship with the project."""

from pathlib import Path

MODELS_FOLDER = Path(__file__).parent
