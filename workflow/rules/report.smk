rule tables:
    input:
        cfg=settings("tables"),
        experiments=f"{OUT}/config/experiments.json",
        scores=lambda wildcards: PLAN.score_files,
    output:
        [
            report(
                f"{OUT}/report/{table}.{kind}",
                category="Tables",
                caption="../report/tables.rst",
                labels={"experiment": table, "format": kind},
            )
            for table in PLAN.tables
            for kind in ("csv", "md", "tex")
        ],
    log:
        f"{OUT}/log/tables.log",
    benchmark:
        f"{OUT}/benchmark/tables/all.tsv"
    shell:
        command("tables")
        + f"io.experiments={{input.experiments:q}} io.results={OUT} io.out={OUT}/report"
        + LOGGED


rule plates:
    input:
        cfg=settings("plates"),
        experiments=f"{OUT}/config/experiments.json",
        networks=lambda wildcards: [
            PLAN.network(PLAN.trainings_of(row)[0])
            for row in PLAN.experiments[wildcards.experiment].rows
        ],
        scores=lambda wildcards: [
            f"{OUT}/{path}"
            for paths in PLAN.scores(wildcards.experiment).values()
            for path in paths
        ],
        packed=f"{OUT}/packed.safetensors",
        lights=f"{OUT}/lights/lights.npz",
        split=lambda wildcards: f"{OUT}/split/{PLAN.split_kind(wildcards.experiment)}.json",
    output:
        plates=report(
            f"{OUT}/report/{{experiment}}_plates.png",
            category="Pictures",
            caption="../report/plates.rst",
            labels={"experiment": "{experiment}", "shows": "a plate"},
        ),
        relit=report(
            f"{OUT}/report/{{experiment}}_relit.png",
            category="Pictures",
            caption="../report/relit.rst",
            labels={"experiment": "{experiment}", "shows": "several lights"},
        ),
        overview=f"{OUT}/report/{{experiment}}_overview.png",
        extremes=report(
            f"{OUT}/report/{{experiment}}_extremes.png",
            category="Pictures",
            caption="../report/extremes.rst",
            labels={"experiment": "{experiment}", "shows": "best and worst"},
        ),
    log:
        f"{OUT}/log/plates.{{experiment}}.log",
    benchmark:
        f"{OUT}/benchmark/plates/{{experiment}}.tsv"
    params:
        condition=lambda wildcards: condition(
            PLAN.condition_folder(wildcards.experiment)
        ),
    shell:
        command("plates")
        + "{params.condition} io.experiments={input.experiments:q} "
        + named("io.experiment", "wildcards.experiment")
        + f"io.results={OUT} io.packed={{input.packed:q}} "
        + "io.lights={input.lights:q} io.split={input.split:q} io.out={output.plates:q} "
        + "io.relit={output.relit:q} io.overview={output.overview:q} io.extremes={output.extremes:q}"
        + LOGGED


rule sheets:
    input:
        cfg=settings("sheets"),
        names=f"{OUT}/config/figures.txt",
        maps=expand(f"{OUT}/maps/{{figure}}.exr", figure=PLAN.figures),
        lights=f"{OUT}/lights/lights.npz",
    output:
        figures=report(
            f"{OUT}/report/figures.png",
            category="Data",
            caption="../report/figures.rst",
            labels={"shows": "figures"},
        ),
        lights=report(
            f"{OUT}/report/lights.png",
            category="Data",
            caption="../report/lights.rst",
            labels={"shows": "lights"},
        ),
        occlusion=f"{OUT}/report/occlusion.csv",
        histogram=f"{OUT}/report/occlusion.png",
    log:
        f"{OUT}/log/sheets.log",
    benchmark:
        f"{OUT}/benchmark/sheets/all.tsv"
    shell:
        command("sheets")
        + f"io.names={{input.names:q}} io.maps={OUT}/maps io.lights={{input.lights:q}} "
        + "io.figures={output.figures:q} io.spheres={output.lights:q} "
        + "io.occlusion={output.occlusion:q} io.histogram={output.histogram:q}"
        + LOGGED


rule report:
    input:
        cfg=settings("report"),
        experiments=f"{OUT}/config/experiments.json",
        record=f"{OUT}/figures.json",
        chain=f"{OUT}/lights/chain.json",
        scores=lambda wildcards: PLAN.score_files,
        curves=expand(f"{OUT}/train/{{training}}.csv", training=PLAN.scored),
        networks=[PLAN.network(training) for training in PLAN.scored],
        plates=expand(
            f"{OUT}/report/{{experiment}}_{{kind}}.png",
            experiment=PLAN.plates,
            kind=["plates", "relit", "overview", "extremes"],
        ),
        figures=f"{OUT}/report/figures.png",
        lights=f"{OUT}/report/lights.png",
        occlusion=f"{OUT}/report/occlusion.csv",
        histogram=f"{OUT}/report/occlusion.png",
        stage_outputs=STAGE_OUTPUTS,
    output:
        page=report(
            f"{OUT}/report/report.html",
            category="Report",
            caption="../report/page.rst",
            labels={"shows": "the whole report"},
        ),
        charts=expand(
            f"{OUT}/report/{{chart}}.png",
            chart=["errors", "curves"] if PLAN.tables else [],
        ),
    log:
        f"{OUT}/log/report.log",
    benchmark:
        f"{OUT}/benchmark/report/all.tsv"
    shell:
        command("report")
        + f"io.experiments={{input.experiments:q}} io.results={OUT} io.out={{output.page:q}}"
        + LOGGED


rule viewer:
    input:
        cfg=settings("viewer"),
        experiments=f"{OUT}/config/experiments.json",
        networks=[
            PLAN.network(PLAN.trainings_of(row)[0])
            for experiment in PLAN.tables[:1]
            for row in PLAN.experiments[experiment].rows
        ],
        packed=f"{OUT}/packed.safetensors",
        split=f"{OUT}/split/{PLAN.split_kind(PLAN.tables[0]) if PLAN.tables else PLAN.cfg.split.kind}.json",
        maps=expand(f"{OUT}/maps/{{figure}}.exr", figure=PLAN.figures),
        lights=f"{OUT}/lights/lights.npz",
    output:
        f"{OUT}/report/viewer.html",
    log:
        f"{OUT}/log/viewer.log",
    benchmark:
        f"{OUT}/benchmark/viewer/all.tsv"
    shell:
        command("viewer")
        + f"io.experiments={{input.experiments:q}} io.results={OUT} io.packed={{input.packed:q}} "
        + f"io.split={{input.split:q}} io.maps={OUT}/maps io.lights={{input.lights:q}} io.out={{output:q}}"
        + LOGGED
