"""Where the models and weights lie that ship with the project."""

from pathlib import Path

# Found from this file and not by an import: a `models.py` beside a user's script would be found
# in its place.
MODELS_FOLDER = Path(__file__).resolve().parents[1] / "models"
