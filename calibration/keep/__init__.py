"""Kept results: profiles, reports, gauge studies, practice."""
