"""The order of all tests."""


def pytest_collection_modifyitems(items):
    """Files with slow tests come first, the workflow's before all: processes deal files out among them, and none is to
    be left alone with a long one at the end."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: (item.path not in slow, item.path.parent.name != "workflow"))
