"""What a document asks for and how a run of it goes, as plain functions: no Prefect, not even through others."""
