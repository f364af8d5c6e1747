FIRST_TABLE = next(map(PLAN.first_trainings, PLAN.experiments), {})


rule tables:
    "Compares the rows of each table, with confidence intervals."
    input:
        [path for name in PLAN.experiments for path in PLAN.results_of(name)],
        record=f"{DATA}/figures.json",
    output:
        [
            report(
                f"{OUT}/report/{table}.{kind}",
                category="Tables",
                labels={"experiment": table, "format": kind},
            )
            for table in PLAN.experiments
            for kind in ("csv", "md")
        ],
    log:
        f"{OUT}/log/tables.log",
    benchmark:
        f"{OUT}/benchmark/tables/all.tsv"
    params:
        experiments=PLAN.described(),
        reported=REPORTED,
        code=code_hash("tables"),
    script:
        "../scripts/tables.py"


rule plates:
    "Draws test figures by the first network of each row of a table."
    input:
        networks=lambda wildcards: [
            PLAN.network(training)
            for training in PLAN.first_trainings(wildcards.experiment).values()
        ],
        packed=PACKED,
        lights=LIGHTS,
        split=SPLIT,
    output:
        plates=f"{OUT}/report/{{experiment}}_plates.png",
        relit=f"{OUT}/report/{{experiment}}_relit.png",
        swapped=f"{OUT}/report/{{experiment}}_swapped.png",
        overview=f"{OUT}/report/{{experiment}}_overview.png",
    log:
        f"{OUT}/log/plates/{{experiment}}.log",
    benchmark:
        f"{OUT}/benchmark/plates/{{experiment}}.tsv"
    params:
        labels=lambda wildcards: PLAN.labels(PLAN.first_trainings(wildcards.experiment)),
        condition=lambda wildcards: PLAN.condition(wildcards.experiment).strip("/")
        or "test",
        code=code_hash("plates"),
    script:
        "../scripts/plates.py"


rule sheets:
    "Draws figures and lights."
    input:
        expand(f"{DATA}/maps/{{batch}}", batch=PLAN.batches),
        lights=LIGHTS,
    output:
        figures=f"{OUT}/report/figures.png",
        lights=f"{OUT}/report/lights.png",
    log:
        f"{OUT}/log/sheets.log",
    benchmark:
        f"{OUT}/benchmark/sheets/all.tsv"
    params:
        maps=PLAN.frontal_maps,
        code=code_hash("sheets"),
    script:
        "../scripts/sheets.py"


rule report:
    "Writes the page that answers the questions of the experiments."
    input:
        networks=[PLAN.network(training) for training in PLAN.scored],
        tables=expand(f"{OUT}/report/{{table}}.csv", table=PLAN.experiments),
        results=[path for name in PLAN.experiments for path in PLAN.results_of(name)],
        plates=expand(
            f"{OUT}/report/{{experiment}}_{{kind}}.png",
            experiment=PLAN.plates,
            kind=["plates", "relit", "swapped", "overview"],
        ),
        record=f"{DATA}/figures.json",
        chain=f"{DATA}/lights/chain.json",
        sheets=rules.sheets.output,
    output:
        report(f"{OUT}/report/report.html", category="Report"),
    log:
        f"{OUT}/log/report.log",
    benchmark:
        f"{OUT}/benchmark/report/all.tsv"
    params:
        experiments=PLAN.described(),
        reported=REPORTED,
        code=code_hash("report"),
    script:
        "../scripts/report.py"


rule viewer:
    "Writes the page with test figures under a light that turns with the mouse."
    input:
        expand(f"{DATA}/maps/{{batch}}", batch=PLAN.batches),
        networks=[PLAN.network(first) for first in FIRST_TABLE.values()],
        packed=PACKED,
        split=SPLIT,
        lights=LIGHTS,
    output:
        f"{OUT}/report/viewer.html",
    log:
        f"{OUT}/log/viewer.log",
    benchmark:
        f"{OUT}/benchmark/viewer/all.tsv"
    params:
        name=SETTINGS["name"],
        labels=PLAN.labels(FIRST_TABLE),
        maps=PLAN.frontal_maps,
        code=code_hash("viewer"),
    script:
        "../scripts/viewer.py"
