"""Recordings and pictures for the browser."""
