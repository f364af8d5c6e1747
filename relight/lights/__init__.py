"""Lights: read, generated, measured, selected, written and drawn."""

from relight.lazy import entry_points

__getattr__, __dir__, __all__ = entry_points(
    __name__,
    {
        "chain": "build_light_set",
        "light": "Light write_light",
        "load": "load_light",
        "select": "select_lights",
        "show": "lit_ball write_contact_sheet write_light_picture",
        "statistics": "measure reference_brightness",
        "table": "LightSet read_light_set write_light_set",
    },
)
