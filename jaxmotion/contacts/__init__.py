"""Contacts with the floor and with things: found, restored, cleaned up."""

from jaxmotion.contacts.contact import FREE, LINE, PLANE, POINT, ContactPoints, Contacts
from jaxmotion.contacts.detect import detect, limb_lengths, replant
from jaxmotion.contacts.distances import fit_distances
from jaxmotion.contacts.feet import find_feet
from jaxmotion.contacts.footskate import cleanup_footskate
from jaxmotion.contacts.intervals import KIND_NAMES, Interval, intervals
from jaxmotion.contacts.limb_ik import LimbTurn, limb_ik
from jaxmotion.contacts.root_cleanup import cleanup_root

__all__ = [
    "FREE",
    "KIND_NAMES",
    "LINE",
    "PLANE",
    "POINT",
    "ContactPoints",
    "Contacts",
    "Interval",
    "LimbTurn",
    "cleanup_footskate",
    "cleanup_root",
    "detect",
    "find_feet",
    "fit_distances",
    "intervals",
    "limb_ik",
    "limb_lengths",
    "replant",
]
