"""Contacts of a skin: what is certain, possible and impossible of them.

A taxel is pressed where its pressure exceeds a threshold, and a *contact* is a connected component
of the pressed taxels T. Of intervals ``[lo, hi]`` only this is known of T: it holds the taxels with
``lo > threshold`` and is held by those with ``hi > threshold``, and by taxels of which nothing is
known. A *core* is a component of the former, a *region* one of the latter. So, for each such T:

- each core lies in one contact, and each contact in one region;
- the contact of core c in region r has from ``|c|`` to ``|r|`` taxels; its area, its force (sum of
  pressure times area) and its centroid are enclosed by what lies between c and r;
- a region with a core has at least one contact, others may have none. No region has more than its
  cores plus the largest independent set of its taxels that are neither in a core nor beside one;
- two cores of one region may belong to one contact; two of different regions do not.

The contacts of two instants are *linked* if they share a taxel: certainly if their cores do,
possibly if their regions do. Chains of links enclose a contact's begin and end.

`find_contacts` answers for one instant, `track_contacts` for a record, and `ContactStream` for
samples that arrive in pieces. Nothing is claimed between instants.
"""

from __future__ import annotations

from eskin.contacts.contacts import Contact, Contacts, Region, Regions, find_contacts
from eskin.contacts.links import Links, link_contacts
from eskin.contacts.skin import Skin
from eskin.contacts.stream import ContactStream, track_contacts
from eskin.contacts.tracks import ContactTrack, ContactTracks

__all__ = [
    "Contact",
    "ContactStream",
    "ContactTrack",
    "ContactTracks",
    "Contacts",
    "Links",
    "Region",
    "Regions",
    "Skin",
    "find_contacts",
    "link_contacts",
    "track_contacts",
]
