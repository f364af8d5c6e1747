# `snakemake all`. The workflow is in workflow/, where the Snakemake Workflow Catalog looks for it.
include: "workflow/Snakefile"
