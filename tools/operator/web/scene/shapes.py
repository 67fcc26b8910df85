"""Shapes of a link, as its URDF has them: boxes, cylinders, spheres, capsules and meshes."""

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .meshes import Meshes
from .poses import of_origin, three

Colours = Mapping[str, list[float]]


def colours_of(root: ET.Element) -> dict[str, list[float]]:
    """Return the colours (4,) that a URDF names for all links, by name."""
    found = {}
    for material in root.findall("material"):
        colour = material.find("color")
        if colour is not None and colour.get("rgba"):
            found[material.get("name", "")] = three(colour, "rgba")
    return found


def shapes_of(
    link: ET.Element, name: str, urdf: Path, meshes: Meshes, colours: Colours
) -> list[dict[str, Any]]:
    """Return the visual shapes of a link of that name, or its collision shapes if it has none."""
    for kind in ("visual", "collision"):
        each = [_shape(element, name, urdf, meshes, colours) for element in link.findall(kind)]
        found = [shape for shape in each if shape is not None]
        if found:
            return found
    return []


def _shape(
    element: ET.Element, link: str, urdf: Path, meshes: Meshes, colours: Colours
) -> dict[str, Any] | None:
    geometry = element.find("geometry")
    if geometry is None or not len(geometry):
        return None
    form = geometry[0]
    shape: dict[str, Any] = {"kind": form.tag, "pose": of_origin(element)}
    match form.tag:
        case "box":
            shape["half_size"] = [0.5 * side for side in three(form, "size")]
        case "cylinder" | "capsule":
            shape |= {"radius": float(form.get("radius", "0"))}
            shape |= {"length": float(form.get("length", "0"))}
        case "sphere":
            shape["radius"] = float(form.get("radius", "0"))
        case "mesh":
            address = meshes.address(link, urdf, form.get("filename", ""))
            if address is None:
                return None
            shape |= {"url": address, "scale": three(form, "scale", "1 1 1")}
    colour = _colour(element, colours)
    return shape if colour is None else {**shape, "colour": colour}


def _colour(element: ET.Element, colours: Colours) -> list[float] | None:
    material = element.find("material")
    if material is None:
        return None
    colour = material.find("color")
    if colour is not None and colour.get("rgba"):
        return three(colour, "rgba")
    return colours.get(material.get("name", ""))
