# Settings of stages, lists and experiments are files in the graph: a change re-runs the stages that read them, and later
# ones. Lists have one name per line.
rule settings:
    output:
        f"{OUT}/config/{{file}}",
    localrule: True
    params:
        text=lambda wildcards: CONFIG.text(wildcards.file),
    shell:
        "printf %s {params.text:q} > {output:q}"
