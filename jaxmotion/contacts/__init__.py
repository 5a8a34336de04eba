"""Contacts with the floor and with things: found, restored, cleaned up."""

from jaxmotion.contacts.contact import FREE, LINE, PLANE, POINT, ContactPoints, Contacts
from jaxmotion.contacts.detect import detect, limb_lengths, replant
from jaxmotion.contacts.feet import find_feet
from jaxmotion.contacts.footskate import cleanup_footskate
from jaxmotion.contacts.limb_ik import LimbTurn, limb_ik

__all__ = [
    "FREE",
    "LINE",
    "PLANE",
    "POINT",
    "ContactPoints",
    "Contacts",
    "LimbTurn",
    "cleanup_footskate",
    "detect",
    "find_feet",
    "limb_ik",
    "limb_lengths",
    "replant",
]
