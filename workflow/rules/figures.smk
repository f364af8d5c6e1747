# From seeds or scans to the packed set. Where ten figures of one decade (g0120 to g0129) are all in the plan, one job makes
# them: a process takes seconds to start, as long as it takes for its work on a figure. Which these are does not
# depend on the machine, nor on how many other figures there are.
for SUFFIX, ONE, NAMES in PLAN.portions:

    if PLAN.scans:

        rule:
            name:
                "scan"
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

        rule:
            name:
                f"figure{SUFFIX}"
            input:
                cfg=settings("figure"),
            output:
                [f"{OUT}/figures/{name}.npz" for name in NAMES],
            log:
                f"{OUT}/log/figure/{ONE}.log",
            benchmark:
                f"{OUT}/benchmark/figure/{ONE}.tsv"
            group:
                "figures"
            resources:
                mem_mb=3000,
            shell:
                command("figure")
                + several(
                    "io.figure", " ".join(NAMES).replace("{", "{wildcards."), SUFFIX
                )
                + several("io.out", "{output:q}", SUFFIX)
                + LOGGED

    rule:
        name:
            f"clean{SUFFIX}"
        input:
            cfg=settings("clean"),
            mesh=[f"{OUT}/figures/{name}.npz" for name in NAMES],
        output:
            [temp(f"{OUT}/clean/{name}.npz") for name in NAMES],
        log:
            f"{OUT}/log/clean/{ONE}.log",
        benchmark:
            f"{OUT}/benchmark/clean/{ONE}.tsv"
        group:
            "figures"
        resources:
            mem_mb=3000,
        shell:
            command("clean")
            + several("io.mesh", "{input.mesh:q}", SUFFIX)
            + several("io.out", "{output:q}", SUFFIX)
            + LOGGED

    rule:
        name:
            f"align{SUFFIX}"
        input:
            cfg=settings("align"),
            mesh=[f"{OUT}/clean/{name}.npz" for name in NAMES],
            table=PLAN.cfg.align.table or [],
        output:
            [f"{OUT}/aligned/{name}.npz" for name in NAMES],
        log:
            f"{OUT}/log/align/{ONE}.log",
        benchmark:
            f"{OUT}/benchmark/align/{ONE}.tsv"
        group:
            "figures"
        resources:
            mem_mb=2000,
        shell:
            command("align")
            + several("io.mesh", "{input.mesh:q}", SUFFIX)
            + several("io.out", "{output:q}", SUFFIX)
            + LOGGED

    rule:
        name:
            f"bake{SUFFIX}"
        input:
            cfg=settings("bake"),
            mesh=[f"{OUT}/aligned/{name}.npz" for name in NAMES],
        output:
            frontal=[ensure(f"{OUT}/maps/{name}.exr", non_empty=True) for name in NAMES],
            views=[
                ensure(f"{OUT}/maps/{view}.exr", non_empty=True)
                for name in NAMES
                for view in PLAN.maps(name)[1:]
            ],
        log:
            f"{OUT}/log/bake/{ONE}.log",
        benchmark:
            f"{OUT}/benchmark/bake/{ONE}.tsv"
        group:
            "figures"
        resources:
            mem_mb=2000,
        shell:
            command("bake")
            + several("io.mesh", "{input.mesh:q}", SUFFIX)
            + several("io.out", "{output.frontal:q}", SUFFIX)
            + LOGGED


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
