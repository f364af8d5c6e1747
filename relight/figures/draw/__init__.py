"""Who and what is drawn: records of person, pose and outfit, and how chance fills them from the catalogue."""
