"""What is kept: profiles, reports, gauge studies, practice."""
