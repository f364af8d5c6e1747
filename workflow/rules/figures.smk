# From seeds or scans to the packed set. A batch is one scan, or up to ten generated figures: a process takes as long to
# start as to draw a figure.
if PLAN.scans:

    rule scan:
        "Reads one of the user's meshes."
        input:
            mesh=lambda wildcards: safe([PLAN.scans[wildcards.batch].path]),
            table=PLAN.table,
        output:
            directory(f"{OUT}/figures/{{batch}}"),
        log:
            f"{OUT}/log/scan/{{batch}}.log",
        benchmark:
            f"{OUT}/benchmark/scan/{{batch}}.tsv"
        group:
            "figures"
        params:
            mesh=lambda wildcards: str(PLAN.scans[wildcards.batch].path),
            subject=lambda wildcards: PLAN.scans[wildcards.batch].subject,
            code=code_hash("scan"),
        script:
            "../scripts/scan.py"

else:

    rule figure:
        "Draws clothed people from their seeds."
        output:
            directory(f"{OUT}/figures/{{batch}}"),
        log:
            f"{OUT}/log/figure/{{batch}}.log",
        benchmark:
            f"{OUT}/benchmark/figure/{{batch}}.tsv"
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
        f"{OUT}/figures/{{batch}}",
    output:
        temp(directory(f"{OUT}/clean/{{batch}}")),
    log:
        f"{OUT}/log/clean/{{batch}}.log",
    benchmark:
        f"{OUT}/benchmark/clean/{{batch}}.tsv"
    group:
        "figures"
    params:
        clean=SETTINGS["clean"],
        code=code_hash("clean"),
    script:
        "../scripts/clean.py"


rule align:
    "Turns meshes upright and towards the camera, and fits them into the image."
    input:
        f"{OUT}/clean/{{batch}}",
        table=SETTINGS["align"]["table"] or [],
    output:
        directory(f"{OUT}/aligned/{{batch}}"),
    log:
        f"{OUT}/log/align/{{batch}}.log",
    benchmark:
        f"{OUT}/benchmark/align/{{batch}}.tsv"
    group:
        "figures"
    params:
        align=SETTINGS["align"],
        code=code_hash("align"),
    script:
        "../scripts/align.py"


rule bake:
    "Bakes light transport, albedo and normals into layered OpenEXR maps, by ray casting."
    input:
        f"{OUT}/aligned/{{batch}}",
    output:
        directory(f"{OUT}/maps/{{batch}}"),
    log:
        f"{OUT}/log/bake/{{batch}}.log",
    benchmark:
        f"{OUT}/benchmark/bake/{{batch}}.tsv"
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
        expand(f"{OUT}/maps/{{batch}}", batch=PLAN.batches),
    output:
        packed=PACKED,
        record=f"{OUT}/figures.json",
    log:
        f"{OUT}/log/pack.log",
    benchmark:
        f"{OUT}/benchmark/pack/all.tsv"
    params:
        maps=PLAN.map_files,
        least=SETTINGS["split"]["least"],
        code=code_hash("pack"),
    script:
        "../scripts/pack.py"


rule split:
    "Divides the figures into training, validation and test."
    input:
        packed=PACKED,
        record=f"{OUT}/figures.json",
    output:
        f"{OUT}/split/{{kind}}.json",
    log:
        f"{OUT}/log/split/{{kind}}.log",
    benchmark:
        f"{OUT}/benchmark/split/{{kind}}.tsv"
    localrule: True
    params:
        split={key: value for key, value in SETTINGS["split"].items() if key != "kind"},
        code=code_hash("split"),
    script:
        "../scripts/split.py"
