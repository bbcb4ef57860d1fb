"""YAML as calibration tools write it, with errors that name the line."""

from __future__ import annotations

import re
from typing import Any

import yaml

__all__ = ["load_yaml"]

NUMBER = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """A safe loader that reads 1e-05 as a number, as YAML 1.2 does, and refuses a key twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """Return a mapping; raise ValueError if a key is there twice."""
        seen = set()
        for key, _ in node.value:
            if key.value in seen:
                raise ValueError(f"line {key.start_mark.line + 1}: {key.value} is there twice")
            seen.add(key.value)
        mapping: dict[Any, Any] = super().construct_mapping(node, deep=deep)
        return mapping

    def untagged(self, _suffix: str, node: yaml.Node) -> Any:  # noqa: ANN401  whatever the file holds
        """Return what a node holds whose tag is unknown, such as !!opencv-matrix."""
        if isinstance(node, yaml.MappingNode):
            return self.construct_mapping(node, deep=True)
        if isinstance(node, yaml.SequenceNode):
            return self.construct_sequence(node, deep=True)
        assert isinstance(node, yaml.ScalarNode)
        return self.construct_scalar(node)


_Loader.add_implicit_resolver("tag:yaml.org,2002:float", NUMBER, list("-+.0123456789"))
_Loader.add_multi_constructor("", _Loader.untagged)


def load_yaml(text: str) -> Any:  # noqa: ANN401  whatever the file holds
    """Return what a YAML file holds: dictionaries, lists, numbers, words, None.

    Args:
        text: of the file; of several documents the first is read.

    Raises:
        ValueError: with the number of the line, if it is no YAML.
    """
    if text.startswith("%YAML:"):  # as OpenCV spells it
        text = text.partition("\n")[2]
    try:
        return next(yaml.load_all(text, _Loader), None)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}: " if mark else ""
        raise ValueError(
            f"{where}{error.problem or error.context}; is the file cut off or edited by hand?"
        ) from error
    except yaml.YAMLError as error:
        raise ValueError(f"it is not YAML ({error})") from error
