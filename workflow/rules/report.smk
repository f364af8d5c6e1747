FIRST_TABLE = next(map(PLAN.first_trainings, PLAN.experiments), {})


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
        plates=shown(f"{OUT}/report/{{experiment}}_plates.png", "Plates"),
        relit=shown(f"{OUT}/report/{{experiment}}_relit.png", "Plates"),
        swapped=shown(f"{OUT}/report/{{experiment}}_swapped.png", "Plates"),
        overview=shown(f"{OUT}/report/{{experiment}}_overview.png", "Plates"),
    log:
        f"{OUT}/log/plates/{{experiment}}.log",
    params:
        labels=lambda wildcards: PLAN.labels(PLAN.first_trainings(wildcards.experiment)),
        condition=lambda wildcards: PLAN.condition(wildcards.experiment).strip("/")
        or "test",
    script:
        "../scripts/plates.py"


rule sheets:
    "Draws figures and lights."
    input:
        maps=expand(f"{DATA}/maps/{{batch}}", batch=PLAN.batches),
        lights=LIGHTS,
    output:
        figures=shown(f"{OUT}/report/figures.png", "Data"),
        lights=shown(f"{OUT}/report/lights.png", "Data"),
    log:
        f"{OUT}/log/sheets.log",
    params:
        figures=list(PLAN.batches.values()),
    script:
        "../scripts/sheets.py"


rule report:
    "Writes the page that answers the questions of the experiments, and its tables."
    input:
        networks=[PLAN.network(training) for training in PLAN.scored],
        results=[path for name in PLAN.experiments for path in PLAN.results_of(name)],
        plates=expand(
            f"{OUT}/report/{{experiment}}_{{kind}}.png",
            experiment=[name for name, one in PLAN.experiments.items() if one.plates],
            kind=["plates", "relit", "swapped", "overview"],
        ),
        record=f"{DATA}/figures.json",
        chain=f"{DATA}/lights/chain.json",
        sheets=rules.sheets.output,
    output:
        page=shown(f"{OUT}/report/report.html", "Report"),
        tables=[
            shown(
                f"{OUT}/report/{table}.{kind}", "Tables", experiment=table, format=kind
            )
            for table in PLAN.experiments
            for kind in ("csv", "md")
        ],
    log:
        f"{OUT}/log/report.log",
    params:
        name=SETTINGS["name"],
        experiments=PLAN.described(),
        reported=REPORTED,
    script:
        "../scripts/report.py"


rule viewer:
    "Writes the page with test figures under a light that turns with the mouse."
    input:
        maps=expand(f"{DATA}/maps/{{batch}}", batch=PLAN.batches),
        networks=[PLAN.network(first) for first in FIRST_TABLE.values()],
        packed=PACKED,
        split=SPLIT,
        lights=LIGHTS,
    output:
        shown(f"{OUT}/report/viewer.html", "Report"),
    log:
        f"{OUT}/log/viewer.log",
    params:
        name=SETTINGS["name"],
        labels=PLAN.labels(FIRST_TABLE),
        figures=list(PLAN.batches.values()),
    script:
        "../scripts/viewer.py"
