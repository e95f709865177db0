"""Connections of serp to the outside: the shipped tasks, and algorithms of other libraries."""

from __future__ import annotations
