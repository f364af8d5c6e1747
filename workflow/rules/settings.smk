# The settings of every stage are a file in the graph: a change re-runs the stages that read them, and later ones.
rule settings:
    output:
        f"{OUT}/config/{{stage}}.yaml",
    localrule: True
    params:
        text=lambda wildcards: PLAN.settings_file(wildcards.stage),
    shell:
        "printf %s {params.text:q} > {output:q}"


MAPS = [name for figure in PLAN.figures for name in PLAN.maps(figure)]


# The figures of this plan, and the maps of all their views, one per line.
rule listing:
    output:
        figures=f"{OUT}/config/figures.txt",
        maps=f"{OUT}/config/maps.txt",
    localrule: True
    params:
        figures="".join(f"{figure}\n" for figure in PLAN.figures),
        maps="".join(f"{name}\n" for name in MAPS),
    shell:
        "printf %s {params.figures:q} > {output.figures:q}; printf %s {params.maps:q} > {output.maps:q}"


# The experiments, for the report.
rule experiments:
    output:
        f"{OUT}/config/experiments.json",
    localrule: True
    params:
        text=lambda wildcards: PLAN.experiments_json(),
    shell:
        "printf %s {params.text:q} > {output:q}"
