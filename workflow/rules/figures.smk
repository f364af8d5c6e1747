# From seeds or scans to the packed set. Where ten figures of one decade (g0120 to g0129) are all in the plan, one job makes
# them: a process takes seconds to start, as long as its work on a figure takes. Which these are does not depend on the
# machine, nor on how many other figures there are.
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


if PLAN.tens:

    use rule figure as figure_tens with:
        output:
            ten("figures"),
        log:
            f"{OUT}/log/figure/{{tens}}.log",
        benchmark:
            f"{OUT}/benchmark/figure/{{tens}}.tsv"

    use rule clean as clean_tens with:
        input:
            cfg=settings("clean"),
            mesh=ten("figures"),
        output:
            [temp(path) for path in ten("clean")],
        log:
            f"{OUT}/log/clean/{{tens}}.log",
        benchmark:
            f"{OUT}/benchmark/clean/{{tens}}.tsv"

    use rule align as align_tens with:
        input:
            cfg=settings("align"),
            mesh=ten("clean"),
            table=PLAN.cfg.align.table or [],
        output:
            ten("aligned"),
        log:
            f"{OUT}/log/align/{{tens}}.log",
        benchmark:
            f"{OUT}/benchmark/align/{{tens}}.tsv"

    use rule bake as bake_tens with:
        input:
            cfg=settings("bake"),
            mesh=ten("aligned"),
        output:
            **maps_of([f"{{tens}}{digit}" for digit in range(10)]),
        log:
            f"{OUT}/log/bake/{{tens}}.log",
        benchmark:
            f"{OUT}/benchmark/bake/{{tens}}.tsv"


rule pack:
    input:
        cfg=settings("pack"),
        names=f"{OUT}/config/maps.txt",
        maps=expand(f"{OUT}/maps/{{name}}.exr", name=MAPS),
    output:
        packed=f"{OUT}/packed.safetensors",
        record=f"{OUT}/figures.json",
    log:
        f"{OUT}/log/pack.log",
    resources:
        mem_mb=4000,
    shell:
        command("pack")
        + f"io.names={{input.names:q}} io.maps={OUT}/maps io.out={{output.packed:q}} io.record={{output.record:q}}"
        + LOGGED


rule split:
    input:
        cfg=settings("split.{kind}"),
        packed=f"{OUT}/packed.safetensors",
        record=f"{OUT}/figures.json",
    output:
        f"{OUT}/split/{{kind}}.json",
    log:
        f"{OUT}/log/split.{{kind}}.log",
    localrule: True
    shell:
        command("split")
        + "io.packed={input.packed:q} io.record={input.record:q} io.out={output:q}"
        + LOGGED
