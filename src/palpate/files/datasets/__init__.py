"""Read LeRobot's data sets (versions 2 and 3), and write copies of them with contacts as further columns."""

from palpate.files.datasets.dataset import Dataset, Episode, is_dataset, read_dataset
from palpate.files.datasets.labelled import write_labelled
from palpate.files.datasets.named import write_named

__all__ = ["Dataset", "Episode", "is_dataset", "read_dataset", "write_labelled", "write_named"]
