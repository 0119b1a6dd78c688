"""Access to the arms of an elastic model, if it knows those of its joints."""

from __future__ import annotations

from ..elastic import ElasticModel
from .model import ArmModel


def with_arms(model: ElasticModel) -> ArmModel | None:
    """Return the model if it knows the arms of every joint and their derivatives; else None."""
    return model if isinstance(model, ArmModel) else None
