"""Maps of figures: the record, its OpenEXR file, its picture, and the packed data set for training."""

from relight.lazy import entry_points

__getattr__, __dir__, __all__ = entry_points(
    __name__,
    {
        "exr": "LeftOut Maps coefficient_names read_info read_maps write_left_out write_maps",
        "packed": "PackedMaps pack_maps",
        "show": "write_maps_picture",
    },
)
