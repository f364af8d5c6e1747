# From seeds or scans to maps. If all ten figures of a decade (g0120 to g0129) are in the plan, one job makes them, since
# a process takes as long to start as it works on a figure. The grouping does not depend on the machine or on the other
# figures.
if PLAN.scans:

    rule scan:
        input:
            cfg=settings("scan"),
            mesh=lambda wildcards: files([PLAN.scans[wildcards.figure].path]),
            table=PLAN.table,
        output:
            f"{OUT}/figures/{{figure}}.npz",
        log:
            f"{OUT}/log/scan/{{figure}}.log",
        benchmark:
            f"{OUT}/benchmark/scan/{{figure}}.tsv"
        group:
            "figures"
        resources:
            mem_mb=4000,
        shell:
            command("scan")
            + named("io.figure", "wildcards.figure")
            + "io.out={output:q}"
            + LOGGED

else:

    rule figure:
        input:
            cfg=settings("figure"),
        output:
            f"{OUT}/figures/{{figure}}.npz",
        log:
            f"{OUT}/log/figure/{{figure}}.log",
        benchmark:
            f"{OUT}/benchmark/figure/{{figure}}.tsv"
        group:
            "figures"
        resources:
            mem_mb=3000,
        shell:
            command("figure")
            + several("io.figure", "$(basename -s .npz {output:q})")
            + several("io.out", "{output:q}")
            + LOGGED


rule clean:
    input:
        cfg=settings("clean"),
        mesh=f"{OUT}/figures/{{figure}}.npz",
    output:
        temp(f"{OUT}/clean/{{figure}}.npz"),
    log:
        f"{OUT}/log/clean/{{figure}}.log",
    benchmark:
        f"{OUT}/benchmark/clean/{{figure}}.tsv"
    group:
        "figures"
    resources:
        mem_mb=3000,
    shell:
        command("clean")
        + several("io.mesh", "{input.mesh:q}")
        + several("io.out", "{output:q}")
        + LOGGED


rule align:
    input:
        cfg=settings("align"),
        mesh=f"{OUT}/clean/{{figure}}.npz",
        table=PLAN.cfg.align.table or [],
    output:
        f"{OUT}/aligned/{{figure}}.npz",
    log:
        f"{OUT}/log/align/{{figure}}.log",
    benchmark:
        f"{OUT}/benchmark/align/{{figure}}.tsv"
    group:
        "figures"
    resources:
        mem_mb=2000,
    shell:
        command("align")
        + several("io.mesh", "{input.mesh:q}")
        + several("io.out", "{output:q}")
        + LOGGED


rule bake:
    input:
        cfg=settings("bake"),
        mesh=f"{OUT}/aligned/{{figure}}.npz",
    output:
        **maps_of(["{figure}"]),
    log:
        f"{OUT}/log/bake/{{figure}}.log",
    benchmark:
        f"{OUT}/benchmark/bake/{{figure}}.tsv"
    group:
        "figures"
    resources:
        mem_mb=2000,
    shell:
        command("bake")
        + several("io.mesh", "{input.mesh:q}")
        + several("io.out", "{output.frontal:q}")
        + LOGGED


if PLAN.decades:

    use rule figure as figure_decade with:
        output:
            decade("figures"),
        log:
            f"{OUT}/log/figure/{{decade}}.log",
        benchmark:
            f"{OUT}/benchmark/figure_decade/{{decade}}.tsv"

    use rule clean as clean_decade with:
        input:
            cfg=settings("clean"),
            mesh=decade("figures"),
        output:
            [temp(path) for path in decade("clean")],
        log:
            f"{OUT}/log/clean/{{decade}}.log",
        benchmark:
            f"{OUT}/benchmark/clean_decade/{{decade}}.tsv"

    use rule align as align_decade with:
        input:
            cfg=settings("align"),
            mesh=decade("clean"),
            table=PLAN.cfg.align.table or [],
        output:
            decade("aligned"),
        log:
            f"{OUT}/log/align/{{decade}}.log",
        benchmark:
            f"{OUT}/benchmark/align_decade/{{decade}}.tsv"

    use rule bake as bake_decade with:
        input:
            cfg=settings("bake"),
            mesh=decade("aligned"),
        output:
            **maps_of([f"{{decade}}{digit}" for digit in range(10)]),
        log:
            f"{OUT}/log/bake/{{decade}}.log",
        benchmark:
            f"{OUT}/benchmark/bake_decade/{{decade}}.tsv"
