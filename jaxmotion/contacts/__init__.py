"""Contacts with the floor and with things: found, restored, cleaned up."""

from jaxmotion.contacts.contact import FREE, LINE, PLANE, POINT, ContactPoints, Contacts
from jaxmotion.contacts.detect import detect, limb_lengths, replant
from jaxmotion.contacts.feet import find_feet

__all__ = [
    "FREE",
    "LINE",
    "PLANE",
    "POINT",
    "ContactPoints",
    "Contacts",
    "detect",
    "find_feet",
    "limb_lengths",
    "replant",
]
