"""What tests of training share."""

import pytest


@pytest.fixture
def one_thread():
    """Networks this small wait for their threads, and wait long on a busy machine."""
    torch = pytest.importorskip("torch")
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
