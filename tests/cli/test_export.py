"""What the package promises at its top is there, documented, and sorted."""

import simaps_viz


def test_every_export_exists_and_is_documented():
    assert simaps_viz.__all__ == sorted(simaps_viz.__all__)
    for name in simaps_viz.__all__:
        said = getattr(simaps_viz, name).__doc__ or ""
        assert said and not said.startswith(f"{name}("), f"{name}: what a dataclass writes for itself says nothing"
