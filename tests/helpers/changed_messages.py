"""Messages with other fields, for tests of what cannot be used."""

from isogal_ros.messages.drivers import set_field
from isogal_ros.topics import Message


def changed(message: Message, **values: object) -> Message:
    """Give a message's fields other values, and return it; a dot in a field's name is two
    underscores."""
    for name, value in values.items():
        set_field(message, name.replace("__", "."), value)
    return message
