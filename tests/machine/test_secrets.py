import pytest

from sucre_bench.machine.text_formats import masked


@pytest.mark.parametrize(
    ("address", "shown"),
    [
        ("postgresql://me:pa:ss@host:5432/runs", "postgresql://me:***@host:5432/runs"),
        ("http://:secret@host", "http://:***@host"),
        ("https://host/x?token=abc&page=2", "https://host/x?token=***&page=2"),
        ("sqlite:////home/me/mlflow.db", "sqlite:////home/me/mlflow.db"),
        ("http://host:5000/#/experiments", "http://host:5000/#/experiments"),
        ("me@host.org, see https://host:80/a@b", "me@host.org, see https://host:80/a@b"),
    ],
)
def test_a_password_is_masked_and_nothing_else(address: str, shown: str):
    assert masked(address) == shown
    assert masked(f"uri: '{address}'\n") == f"uri: '{shown}'\n"
