"""The table of peers: what is compared and how it is fetched, without PyTorch and without their code."""
import sys

import pytest

from motion_jax.models import registry
from tests.conftest import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))
import method_peers  # noqa: E402


def test_each_further_method_has_a_peer_at_a_commit(capsys):
  assert {"mdm", "mld", "t2m_gpt", "momask", "motionstreamer"} == method_peers.PEERS.keys()
  assert method_peers.PEERS.keys() <= {stage.partition(".")[0] for stage in registry.setups()}
  assert method_peers.main(["--list"]) == 0
  text = capsys.readouterr().out
  for method, peer in method_peers.PEERS.items():
    assert f"github.com/{peer.repository} {method} && git -C {method} checkout {peer.commit[:12]}" in text
  with pytest.raises(SystemExit):
    method_peers.main([])


def test_ratios_and_rows_that_did_not_run():
  text = method_peers.table({
      "mdm": dict(theirs=[3.0, 4.0], ours=[2.0, 1.0], parameters=(17_900_000, 17_900_000), others=0.0),
      "mld": dict(error="it did not run")})
  assert "| 17.9 | 3.000 | 2.000 | 1.50 | 4.00 | 120 |  |" in text and text.splitlines()[3].endswith("it did not run |")
