# Experiments that are not tables of trainings. Each has stages of its own; its rows are the networks that it uses.
TEST_SPLIT = f"{OUT}/split/{PLAN.cfg.split.kind}.json"


rule light_transfer:
    input:
        cfg=settings("light_transfer"),
        experiments=f"{OUT}/config/experiments.json",
        networks=networks_of("light_transfer"),
        packed=f"{OUT}/packed.safetensors",
        split=TEST_SPLIT,
        lights=f"{OUT}/lights/lights.npz",
    output:
        f"{OUT}/light_transfer/scores.csv",
    log:
        f"{OUT}/log/light_transfer.log",
    benchmark:
        f"{OUT}/benchmark/light_transfer/all.tsv"
    resources:
        mem_mb=8000,
        gpu=PLAN.gpus,
    shell:
        command("light_transfer")
        + f"io.experiments={{input.experiments:q}} io.networks={OUT}/train io.packed={{input.packed:q}} "
        + "io.lights={input.lights:q} io.split={input.split:q} io.out={output:q}"
        + LOGGED


rule trace:
    input:
        cfg=settings("trace"),
        packed=f"{OUT}/packed.safetensors",
        split=TEST_SPLIT,
        lights=f"{OUT}/lights/lights.npz",
        meshes=expand(f"{OUT}/aligned/{{figure}}.npz", figure=PLAN.figures),
    output:
        f"{OUT}/path_traced/traced.npz",
    log:
        f"{OUT}/log/trace.log",
    benchmark:
        f"{OUT}/benchmark/trace/all.tsv"
    threads: workflow.cores
    resources:
        mem_mb=8000,
    shell:
        command("trace")
        + "io.packed={input.packed:q} io.split={input.split:q} io.lights={input.lights:q} "
        + f"io.meshes={OUT}/aligned io.out={{output:q}}"
        + LOGGED


rule path_traced:
    input:
        cfg=settings("path_traced"),
        experiments=f"{OUT}/config/experiments.json",
        networks=networks_of("path_traced"),
        packed=f"{OUT}/packed.safetensors",
        lights=f"{OUT}/lights/lights.npz",
        traced=f"{OUT}/path_traced/traced.npz",
    output:
        f"{OUT}/path_traced/scores.csv",
    log:
        f"{OUT}/log/path_traced.log",
    benchmark:
        f"{OUT}/benchmark/path_traced/all.tsv"
    resources:
        mem_mb=8000,
        gpu=PLAN.gpus,
    shell:
        command("path_traced")
        + f"io.experiments={{input.experiments:q}} io.networks={OUT}/train io.packed={{input.packed:q}} "
        + "io.lights={input.lights:q} io.traced={input.traced:q} io.out={output:q}"
        + LOGGED


rule plate:
    input:
        cfg=settings("plate"),
        experiments=f"{OUT}/config/experiments.json",
        networks=lambda wildcards: networks_of(wildcards.experiment),
        packed=f"{OUT}/packed.safetensors",
        lights=f"{OUT}/lights/lights.npz",
        reference=lambda wildcards: (
            TEST_SPLIT
            if wildcards.experiment == "light_transfer"
            else f"{OUT}/path_traced/traced.npz"
        ),
    output:
        f"{OUT}/{{experiment}}/plate.png",
    log:
        f"{OUT}/log/plate.{{experiment}}.log",
    benchmark:
        f"{OUT}/benchmark/plate/{{experiment}}.tsv"
    resources:
        mem_mb=8000,
        gpu=PLAN.gpus,
    shell:
        command("plate")
        + "io.experiments={input.experiments:q} "
        + named("io.experiment", "wildcards.experiment")
        + f"io.networks={OUT}/train io.packed={{input.packed:q}} io.lights={{input.lights:q}} "
        + "io.reference={input.reference:q} io.out={output:q}"
        + LOGGED


STAGE_OUTPUTS = [
    path
    for name, experiment in PLAN.experiments.items()
    if not experiment.table
    for path in PLAN.stage_outputs(name)
]
