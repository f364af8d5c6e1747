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
            + named("io.figure", "wildcards.figure")
            + "io.out={output:q}"
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
        command("clean") + "io.mesh={input.mesh:q} io.out={output:q}" + LOGGED


rule align:
    input:
        cfg=settings("align"),
        mesh=f"{OUT}/clean/{{figure}}.npz",
        table=PLAN.cfg.align.table or [],
    output:
        f"{OUT}/aligned/{{figure}}.npz",
    log:
        f"{OUT}/log/align/{{figure}}.log",
    group:
        "figures"
    resources:
        mem_mb=2000,
    shell:
        command("align") + "io.mesh={input.mesh:q} io.out={output:q}" + LOGGED


rule bake:
    input:
        cfg=settings("bake"),
        mesh=f"{OUT}/aligned/{{figure}}.npz",
    output:
        [
            ensure(f"{OUT}/maps/{name}.exr", non_empty=True)
            for name in PLAN.maps("{figure}")
        ],
    log:
        f"{OUT}/log/bake/{{figure}}.log",
    benchmark:
        f"{OUT}/benchmark/bake/{{figure}}.tsv"
    group:
        "figures"
    resources:
        mem_mb=2000,
    shell:
        command("bake") + "io.mesh={input.mesh:q} io.out={output[0]:q}" + LOGGED


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
