"""Contacts with the floor and with things: found, restored, cleaned up."""

from jaxmotion.contacts.contact import FREE, LINE, PLANE, POINT, ContactPoints, Contacts

__all__ = ["FREE", "LINE", "PLANE", "POINT", "ContactPoints", "Contacts"]
