"""Two dask workers, which the tests of a module share."""

import pytest


@pytest.fixture(scope="module")
def client(tmp_path_factory):
    """A client of two workers that the scheduler gives up after two deaths over one task."""
    pytest.importorskip("distributed", reason="dask is not there: jaxmotion[distributed]")
    from dask import config

    from jaxmotion.corpus import local_client

    with config.set({"distributed.scheduler.allowed-failures": 1}), local_client(2) as client:
        yield client
