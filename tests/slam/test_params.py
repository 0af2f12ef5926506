"""Parameters are strict: a misspelt key and a value out of range are named, and nothing changes afterwards."""

from __future__ import annotations

import importlib
import pkgutil

import pytest
from pydantic import ValidationError

import slam
from slam.local_map import MAX_REACH, LocalMap, LocalMapParams
from slam.params import Params
from slam.path_filter import PathFilterParams
from slam.rangefinder import RingParams


def all_params():
    """Every parameter class of the library."""
    for module in pkgutil.iter_modules(slam.__path__):
        importlib.import_module(f"slam.{module.name}")
    return sorted(Params.__subclasses__(), key=lambda params: params.__name__)


ALL = [params for params in all_params() if params.__module__.startswith("slam.")]
WITH_DEFAULTS = [params for params in ALL if params is not RingParams]


def test_there_are_some():
    assert PathFilterParams in ALL


@pytest.mark.parametrize("params", WITH_DEFAULTS, ids=lambda params: params.__name__)
def test_defaults_are_valid_and_survive_writing_and_reading(params):
    made = params()
    assert params.model_validate(made.model_dump()) == made
    assert params.model_validate_json(made.model_dump_json()) == made


@pytest.mark.parametrize("params", ALL, ids=lambda params: params.__name__)
def test_an_unknown_key_is_an_error_that_names_it(params):
    with pytest.raises(ValidationError, match="treshold"):
        params.model_validate({"treshold": 1})


@pytest.mark.parametrize("params", WITH_DEFAULTS, ids=lambda params: params.__name__)
def test_parameters_are_frozen(params):
    made = params()
    for name in params.model_fields:
        with pytest.raises(ValidationError, match="frozen"):
            setattr(made, name, getattr(made, name))


@pytest.mark.parametrize("params", WITH_DEFAULTS, ids=lambda params: params.__name__)
def test_every_default_lies_within_its_own_limits(params):
    made = params()
    for name in params.model_fields:
        params.model_validate({name: getattr(made, name)})


def test_a_deep_mistake_is_named_by_its_path():
    with pytest.raises(ValidationError) as caught:
        PathFilterParams.model_validate({"comparison": {"affinity": {"n_pionts": 64}}})
    assert caught.value.errors()[0]["loc"] == ("comparison", "affinity", "n_pionts")
    with pytest.raises(ValidationError) as caught:
        PathFilterParams.model_validate({"comparison": {"affinity": {"states": 4}}})
    assert caught.value.errors()[0]["loc"] == ("comparison", "affinity", "states")


@pytest.mark.parametrize(
    "wrong",
    [
        {"particles": 0}, {"threshold": 1.5}, {"threshold": -0.1}, {"reach": 0.0}, {"particles": 2.5},
        {"motion": {"turn_noise": -1.0}}, {"comparison": {"range": 0.0}}, {"comparison": {"gap": 0}},
        {"direction": {"memory": 1.1}},
    ],
    ids=str,
)  # fmt: skip
def test_values_out_of_range_are_refused(wrong):
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        PathFilterParams.model_validate(wrong)


def test_defaults_are_not_shared_between_objects():
    changed = PathFilterParams.model_validate({"motion": {"turn_noise": 0.5}})
    assert changed.motion.turn_noise == 0.5
    assert PathFilterParams().motion.turn_noise != 0.5


def test_a_sonar_without_a_cone_is_refused():
    with pytest.raises(ValidationError, match="half_angle_deg"):
        RingParams(model="sonar", bearings_deg=(0.0,))
    assert RingParams(model="sonar", bearings_deg=(0.0,), half_angle_deg=15.0).half_angle > 0.0


@pytest.mark.parametrize("value", [float("inf"), float("-inf"), float("nan")])
def test_numbers_are_finite_unless_infinity_means_something(value):
    with pytest.raises(ValidationError, match="finite"):
        PathFilterParams.model_validate({"comparison": {"affinity": {"gain": value}}})
    with pytest.raises(ValidationError, match="finite"):
        RingParams(model="beam", bearings_deg=(value,))
    never = PathFilterParams.model_validate({"comparison": {"affinity": {"early_exit": float("-inf")}}})
    assert never.comparison.affinity.early_exit == float("-inf")


def test_the_local_map_stays_small():
    with pytest.raises(ValidationError, match="reach"):
        LocalMapParams(reach=200.0)
    far = RingParams(model="beam", bearings_deg=(0.0,), max_range=200.0)
    assert LocalMap(LocalMapParams(), {"laser": far}).reach == MAX_REACH
