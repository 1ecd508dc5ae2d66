"""Fixtures that several test files share."""

from pathlib import Path

import pytest
from small_models import write_controller


@pytest.fixture(scope="session")
def controller_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small controller that stands and sways a little."""
    return write_controller(tmp_path_factory.mktemp("controller"))
