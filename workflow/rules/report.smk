rule tables:
    input:
        cfg=settings("tables"),
        experiments=f"{OUT}/config/experiments.json",
        scores=expand(f"{OUT}/evaluate/{{run}}.csv", run=PLAN.scored),
        baselines=f"{OUT}/evaluate/baselines.csv",
    output:
        report(
            expand(
                f"{OUT}/report/{{table}}.{{kind}}",
                table=PLAN.tables,
                kind=["csv", "md", "tex"],
            ),
            category="Tables",
            caption="../report/tables.rst",
        ),
    log:
        f"{OUT}/log/tables.log",
    shell:
        command("tables")
        + f"io.experiments={{input.experiments}} io.scores={OUT}/evaluate "
        + f"io.baselines={{input.baselines}} io.out={OUT}/report"
        + LOGGED


rule plates:
    input:
        cfg=settings("plates"),
        runs=f"{OUT}/config/runs.txt",
        networks=expand(f"{OUT}/train/{{run}}.safetensors", run=PLAN.scored),
        packed=f"{OUT}/packed.safetensors",
        lights=f"{OUT}/lights/lights.npz",
        split=f"{OUT}/split.json",
    output:
        report(
            f"{OUT}/report/plates.png",
            category="Pictures",
            caption="../report/plates.rst",
        ),
    log:
        f"{OUT}/log/plates.log",
    shell:
        command("plates")
        + f"io.runs={{input.runs}} io.networks={OUT}/train io.packed={{input.packed}} "
        + "io.lights={input.lights} io.split={input.split} io.out={output}"
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
        ),
        lights=report(
            f"{OUT}/report/lights.png", category="Data", caption="../report/lights.rst"
        ),
        occlusion=f"{OUT}/report/occlusion.csv",
        histogram=f"{OUT}/report/occlusion.png",
    log:
        f"{OUT}/log/sheets.log",
    shell:
        command("sheets")
        + f"io.names={{input.names}} io.maps={OUT}/maps io.lights={{input.lights}} "
        + "io.figures={output.figures} io.spheres={output.lights} "
        + "io.occlusion={output.occlusion} io.histogram={output.histogram}"
        + LOGGED


rule report:
    input:
        cfg=settings("report"),
        experiments=f"{OUT}/config/experiments.json",
        runs=f"{OUT}/config/runs.txt",
        record=f"{OUT}/figures.json",
        chain=f"{OUT}/lights/chain.json",
        scores=expand(f"{OUT}/evaluate/{{run}}.csv", run=PLAN.scored),
        baselines=f"{OUT}/evaluate/baselines.csv",
        curves=expand(f"{OUT}/train/{{run}}.csv", run=PLAN.scored),
        plates=f"{OUT}/report/plates.png",
        figures=f"{OUT}/report/figures.png",
        lights=f"{OUT}/report/lights.png",
        occlusion=f"{OUT}/report/occlusion.csv",
        histogram=f"{OUT}/report/occlusion.png",
    output:
        page=report(
            f"{OUT}/report/report.html",
            category="Report",
            caption="../report/page.rst",
        ),
        errors=f"{OUT}/report/errors.png",
        curves=f"{OUT}/report/curves.png",
    log:
        f"{OUT}/log/report.log",
    shell:
        command("report")
        + f"io.experiments={{input.experiments}} io.runs={{input.runs}} io.results={OUT} io.out={{output.page}}"
        + LOGGED


rule viewer:
    input:
        cfg=settings("viewer"),
        split=f"{OUT}/split.json",
        maps=expand(f"{OUT}/maps/{{figure}}.exr", figure=PLAN.figures),
        lights=f"{OUT}/lights/lights.npz",
    output:
        f"{OUT}/report/viewer.html",
    log:
        f"{OUT}/log/viewer.log",
    shell:
        command("viewer")
        + f"io.split={{input.split}} io.maps={OUT}/maps io.lights={{input.lights}} io.out={{output}}"
        + LOGGED
