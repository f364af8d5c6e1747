# From figures to the packed set.
include: "meshes.smk"


rule pack:
    input:
        cfg=settings("pack"),
        names=f"{OUT}/config/maps.txt",
        maps=expand(f"{OUT}/maps/{{name}}.exr", name=PLAN.map_names),
    output:
        packed=f"{OUT}/packed.safetensors",
        record=f"{OUT}/figures.json",
    log:
        f"{OUT}/log/pack.log",
    benchmark:
        f"{OUT}/benchmark/pack/all.tsv"
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
    benchmark:
        f"{OUT}/benchmark/split/{{kind}}.tsv"
    localrule: True
    shell:
        command("split")
        + "io.packed={input.packed:q} io.record={input.record:q} io.out={output:q}"
        + LOGGED
