"""Helm's settings: what is wrong is said in one line."""

from __future__ import annotations

import pytest

from common.config import ConfigError, build
from onboard.helm.config import HelmConfig


@pytest.mark.parametrize(
    "url",
    ["udpin://127.0.0.1:14540", "udpout://10.0.0.2:14550", "tcpout://autopilot:5760", "serial:///dev/ttyACM0:57600"],
)
def test_urls_that_mavsdk_takes(url: str):
    assert build(HelmConfig, {"autopilot_url": url}, "t").autopilot_url == url


@pytest.mark.parametrize(
    "url", ["udp://:14540", "udpin://127.0.0.1", "127.0.0.1:14540", "udpin://127.0.0.1:99999", "serial://ttyACM0", ""]
)
def test_a_wrong_url_is_refused_with_an_example(url: str):
    with pytest.raises(ConfigError, match=r"autopilot_url: got .* expected udpin://HOST:PORT.*for example"):
        build(HelmConfig, {"autopilot_url": url}, "t")


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ({"return_height_m": 50.0}, "return_height_m: got 50.0, expected 1.5 to 20"),
        ({"containment": {"height_min_m": 30.0}}, "height_min_m"),
        ({"containment": {"fence_band_m": 80.0}}, "fence_band_m"),
        ({"containment": {"raduis_m": 80.0}}, "did you mean 'radius_m'"),
        ({"parameters": {"COM_OF_LOSS_T": 30.0}}, "COM_OF_LOSS_T: got 30"),
        ({"link_loss_action": "panic"}, "link_loss_action"),
        ({"freshness_s": 5.0}, "freshness_s"),
    ],
)
def test_limits_in_contradiction_are_refused(table, text: str):
    with pytest.raises(ConfigError, match=text):
        build(HelmConfig, table, "kite [helm]")


def test_whole_numbers_stay_integer_parameters():
    parameters = build(HelmConfig, {"parameters": {"COM_OBL_RC_ACT": 4, "COM_OF_LOSS_T": 0.8}}, "t").parameters
    assert isinstance(parameters["COM_OBL_RC_ACT"], int)
    assert isinstance(parameters["COM_OF_LOSS_T"], float)
