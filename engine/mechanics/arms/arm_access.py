"""Access to elastic models that have separate arms."""

from __future__ import annotations

from ..elastic import ElasticModel
from .model import ArmModel


def as_arm_model(model: ElasticModel) -> ArmModel | None:
    """Return the model if it is the arm model, which describes the two arms of every joint separately; else None."""
    return model if isinstance(model, ArmModel) else None
