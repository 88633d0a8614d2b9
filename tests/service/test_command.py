"""`haptix serve`: wrong arguments end in one sentence, before a device is opened."""

import pytest
from typer.testing import CliRunner

from haptix.cli.application import app
from haptix.errors import HaptixError


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--listen", "localhost"], "expected --certificate and --key too"),
        (["--certificate", "FILE", "--key", "FILE"], "are for --listen"),
        (["--listen", "localhost", "--certificate", "FILE", "--key", "FILE"], "in PEM"),
    ],
)
def test_one_sentence(tmp_path, options, words):
    file = tmp_path / "certificate.pem"
    file.write_text("no certificate")
    options = [str(file) if option == "FILE" else option for option in options]
    done = CliRunner().invoke(app, ["serve", "--port", "0", *options])
    assert isinstance(done.exception, HaptixError)
    assert words in str(done.exception) and "\n" not in str(done.exception)
