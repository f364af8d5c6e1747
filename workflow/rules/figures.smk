# From seeds or scans to the packed set. A batch is one scan, or up to ten generated figures: a process takes as long to
# start as to draw a figure.
if PLAN.scans:

    rule scan:
        "Reads one of the user's meshes."
        input:
            mesh=lambda wildcards: safe([PLAN.scans[wildcards.batch].path]),
            table=PLAN.table,
        output:
            directory(f"{DATA}/figures/{{batch}}"),
        log:
            f"{DATA}/log/scan/{{batch}}.log",
        benchmark:
            f"{DATA}/benchmark/scan/{{batch}}.tsv"
        group:
            "figures"
        params:
            mesh=lambda wildcards: str(PLAN.scans[wildcards.batch].path),
            subject=lambda wildcards: PLAN.scans[wildcards.batch].subject,
            stamps=lambda wildcards: PLAN.scan_stamps[wildcards.batch],
            code=code_hash("scan"),
        script:
            "../scripts/scan.py"

else:

    rule figure:
        "Draws clothed people from their seeds."
        output:
            directory(f"{DATA}/figures/{{batch}}"),
        log:
            f"{DATA}/log/figure/{{batch}}.log",
        benchmark:
            f"{DATA}/benchmark/figure/{{batch}}.tsv"
        group:
            "figures"
        params:
            names=lambda wildcards: PLAN.batches[wildcards.batch],
            figures={
                key: value
                for key, value in SETTINGS["figures"].items()
                if key not in ("first", "count")
            },
            code=code_hash("figure", [SETTINGS["figures"]["source"]]),
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
    benchmark:
        f"{DATA}/benchmark/clean/{{batch}}.tsv"
    group:
        "figures"
    params:
        code=code_hash("clean"),
    script:
        "../scripts/clean.py"


rule align:
    "Turns meshes upright and towards the camera, and fits them into the image."
    input:
        f"{DATA}/clean/{{batch}}",
        table=SETTINGS["align"]["table"] or [],
    output:
        directory(f"{DATA}/aligned/{{batch}}"),
    log:
        f"{DATA}/log/align/{{batch}}.log",
    benchmark:
        f"{DATA}/benchmark/align/{{batch}}.tsv"
    group:
        "figures"
    params:
        *stamps([SETTINGS["align"]["table"]]),
        align=SETTINGS["align"],
        code=code_hash("align"),
    script:
        "../scripts/align.py"


rule bake:
    "Bakes light transport, albedo and normals into layered OpenEXR maps, by ray casting."
    input:
        f"{DATA}/aligned/{{batch}}",
    output:
        directory(f"{DATA}/maps/{{batch}}"),
    log:
        f"{DATA}/log/bake/{{batch}}.log",
    benchmark:
        f"{DATA}/benchmark/bake/{{batch}}.tsv"
    group:
        "figures"
    params:
        bake=SETTINGS["bake"],
        code=code_hash("bake"),
    script:
        "../scripts/bake.py"


rule pack:
    "Joins the maps of all figures into the one file that trainings read."
    input:
        expand(f"{DATA}/maps/{{batch}}", batch=PLAN.batches),
    output:
        packed=PACKED,
        record=f"{DATA}/figures.json",
    log:
        f"{DATA}/log/pack.log",
    benchmark:
        f"{DATA}/benchmark/pack/all.tsv"
    params:
        maps=PLAN.map_files,
        code=code_hash("pack"),
    script:
        "../scripts/pack.py"
