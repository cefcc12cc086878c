"""Options of `outrider keys`, apart from the work itself: reading a command line needs no cryptography."""

from __future__ import annotations

import argparse


def add_keys(sub: argparse._SubParsersAction) -> argparse.ArgumentParser:
    """Add the subcommand `keys`; returns its parser, which still wants the options of every command."""
    keys = sub.add_parser(
        "keys",
        help="Make certificates and passwords for two machines",
        description="Make an authority, the certificates of the vehicle's and the ground station's router, and a "
        "password for every process; each machine gets its own part of the folder. See docs/two-machines.md.",
    )
    keys.add_argument("--folder", metavar="FOLDER", default="keys", help="where to (default: keys)")
    keys.add_argument(
        "--vehicle-host",
        metavar="HOST",
        action="append",
        default=[],
        help="name or address under which the ground reaches the vehicle; may be repeated (bus.link's is always in)",
    )
    keys.add_argument(
        "--ground-host", metavar="HOST", action="append", default=[], help="the same for the ground station"
    )
    keys.add_argument("--days", type=int, default=365, help="how long the certificates are valid (default: 365)")
    keys.add_argument("--ca", metavar="FOLDER", help="folder with ca.pem and ca.key of an authority that exists")
    keys.add_argument("--renew", action="store_true", help="new certificates; the authority and the passwords stay")
    keys.add_argument("--force", action="store_true", help="make everything anew over what is there")
    keys.add_argument("--check", action="store_true", help="make nothing; say what is wrong with the folder")
    keys.add_argument("--zenohd", metavar="FOLDER", help="make no keys; write configuration files for plain zenohd")
    return keys
