# `snakemake all`. The workflow is in workflow/, where the Snakemake Workflow Catalog looks for it.
include: "workflow/Snakefile"


workflow.default_target = "all"  # of `snakemake` alone, which an include takes away
