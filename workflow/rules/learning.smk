def split_of(run):
    """The split that a run is trained and scored on."""
    return f"{OUT}/split/{PLAN.of_run(run).split.kind}.json"


def condition(on):
    """Overrides for the figures and lights that a folder of scores is about: "" or "sitting-test/"."""
    figures, lights = on.rstrip("/").split("-") if on else ("test", "test")
    return f"evaluate.figures={figures} evaluate.lights={lights}"


rule train:
    input:
        cfg=settings("train.{run}"),
        packed=f"{OUT}/packed.safetensors",
        split=lambda wildcards: split_of(wildcards.run),
        lights=f"{OUT}/lights/lights.npz",
        start=lambda wildcards: PLAN.start(wildcards.run),
    output:
        network=f"{OUT}/train/{{run}}.safetensors",
        curve=f"{OUT}/train/{{run}}.csv",
    log:
        f"{OUT}/log/train/{{run}}.log",
    benchmark:
        f"{OUT}/benchmark/train/{{run}}.tsv"
    resources:
        mem_mb=8000,
        runtime=1440,
        gpu=PLAN.gpus,
    shell:
        command("train")
        + "io.packed={input.packed:q} io.split={input.split:q} io.lights={input.lights:q} "
        + "io.out={output.network:q} io.curve={output.curve:q}"
        + LOGGED_RUN


rule evaluate:
    input:
        cfg=settings("evaluate"),
        packed=f"{OUT}/packed.safetensors",
        split=lambda wildcards: split_of(wildcards.run),
        lights=f"{OUT}/lights/lights.npz",
        network=f"{OUT}/train/{{run}}.safetensors",
    output:
        scores=f"{OUT}/evaluate/{{on}}{{run}}.csv",
        plate=f"{OUT}/evaluate/{{on}}{{run}}.png",
    log:
        f"{OUT}/log/evaluate/{{on}}{{run}}.log",
    benchmark:
        f"{OUT}/benchmark/evaluate/{{on}}{{run}}.tsv"
    resources:
        mem_mb=8000,
        gpu=PLAN.gpus,
    params:
        condition=lambda wildcards: condition(wildcards.on),
    shell:
        command("evaluate")
        + "{params.condition} io.packed={input.packed:q} io.split={input.split:q} io.lights={input.lights:q} "
        + "io.network={input.network:q} io.out={output.scores:q} io.plate={output.plate:q}"
        + LOGGED_RUN


rule baselines:
    input:
        cfg=settings("baselines"),
        packed=f"{OUT}/packed.safetensors",
        split=f"{OUT}/split/{{kind}}.json",
        lights=f"{OUT}/lights/lights.npz",
    output:
        f"{OUT}/evaluate/{{on}}baselines.{{kind}}.csv",
    log:
        f"{OUT}/log/evaluate/{{on}}baselines.{{kind}}.log",
    benchmark:
        f"{OUT}/benchmark/baselines/{{on}}{{kind}}.tsv"
    resources:
        mem_mb=8000,
    params:
        condition=lambda wildcards: condition(wildcards.on),
    shell:
        command("baselines")
        + "{params.condition} io.packed={input.packed:q} io.split={input.split:q} io.lights={input.lights:q} "
        + "io.out={output:q}"
        + LOGGED
