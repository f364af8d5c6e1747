# From seeds or scans to the packed set. A batch is one scan, or up to ten generated figures: a process takes as long to
# start as to draw a figure.
if PLAN.scans:

    rule scan:
        "Reads one of the user's meshes."
        input:
            lambda wildcards: safe([PLAN.scans[wildcards.batch].path]),
            PLAN.table,
        output:
            update(directory(f"{DATA}/figures/{{batch}}")),
        log:
            f"{DATA}/log/scan/{{batch}}.log",
        params:
            mesh=lambda wildcards: str(PLAN.scans[wildcards.batch].path),
            subject=lambda wildcards: PLAN.scans[wildcards.batch].subject,
        script:
            "../scripts/scan.py"

else:

    rule figure:
        "Draws clothed people from their seeds."
        output:
            update(directory(f"{DATA}/figures/{{batch}}")),
        log:
            f"{DATA}/log/figure/{{batch}}.log",
        params:
            names=lambda wildcards: PLAN.batches[wildcards.batch],
            figures={
                key: value
                for key, value in SETTINGS["figures"].items()
                if key not in ("first", "count")
            },
        script:
            "../scripts/figure.py"


rule clean:
    "Repairs meshes."
    input:
        f"{DATA}/figures/{{batch}}",
    output:
        temp(directory(f"{DATA}/clean/{{batch}}")),
    log:
        f"{DATA}/log/clean/{{batch}}.log",
    script:
        "../scripts/clean.py"


rule align:
    "Turns meshes upright and towards the camera, and fits them into the image."
    input:
        f"{DATA}/clean/{{batch}}",
        table=SETTINGS["align"]["table"] or [],
    output:
        update(directory(f"{DATA}/aligned/{{batch}}")),
    log:
        f"{DATA}/log/align/{{batch}}.log",
    params:
        align=SETTINGS["align"],
    script:
        "../scripts/align.py"


rule bake:
    "Bakes light transport, albedo and normals into layered OpenEXR maps, by ray casting."
    input:
        f"{DATA}/aligned/{{batch}}",
    output:
        update(directory(f"{DATA}/maps/{{batch}}")),
    log:
        f"{DATA}/log/bake/{{batch}}.log",
    resources:
        mem_mb=memory,
        runtime=minutes,
    params:
        bake=SETTINGS["bake"],
    script:
        "../scripts/bake.py"


rule pack:
    "Joins the maps of all figures into the one file that trainings read."
    input:
        expand(f"{DATA}/maps/{{batch}}", batch=PLAN.batches),
    output:
        packed=update(PACKED),
        record=update(f"{DATA}/figures.json"),
    log:
        f"{DATA}/log/pack.log",
    params:
        names=PLAN.map_names,
    script:
        "../scripts/pack.py"
