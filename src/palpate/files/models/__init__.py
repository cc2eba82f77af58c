"""Read and write all kinds of models as files, and record the provenance of results."""

from palpate.files.inputs import load_toml
from palpate.files.models.kinds import MODELS, read_model, write_model
from palpate.files.models.provenance import printable, provenance, read_provenance, write_provenance
from palpate.files.models.toml import toml_array

__all__ = [
    "MODELS",
    "load_toml",
    "printable",
    "provenance",
    "read_model",
    "read_provenance",
    "toml_array",
    "write_model",
    "write_provenance",
]
