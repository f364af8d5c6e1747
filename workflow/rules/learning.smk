rule train:
    input:
        cfg=settings("train.{training}"),
        packed=f"{OUT}/packed.safetensors",
        split=lambda wildcards: split_of(wildcards.training),
        lights=f"{OUT}/lights/lights.npz",
        start=lambda wildcards: PLAN.start_network(wildcards.training),
    output:
        network=f"{OUT}/train/{{training}}.safetensors",
        curve=f"{OUT}/train/{{training}}.csv",
    log:
        f"{OUT}/log/train/{{training}}.log",
    benchmark:
        f"{OUT}/benchmark/train/{{training}}.tsv"
    resources:
        mem_mb=8000,
        runtime=1440,
        gpu=PLAN.gpus,
    shell:
        command("train")
        + "io.packed={input.packed:q} io.split={input.split:q} io.lights={input.lights:q} "
        + "io.out={output.network:q} io.curve={output.curve:q}"
        + LOGGED_TRAINING


rule evaluate:
    input:
        cfg=settings("evaluate"),
        packed=f"{OUT}/packed.safetensors",
        split=lambda wildcards: split_of(wildcards.training),
        lights=f"{OUT}/lights/lights.npz",
        network=f"{OUT}/train/{{training}}.safetensors",
    output:
        f"{OUT}/evaluate/{{on}}{{training}}.csv",
    log:
        f"{OUT}/log/evaluate/{{on}}{{training}}.log",
    benchmark:
        f"{OUT}/benchmark/evaluate/{{on}}{{training}}.tsv"
    resources:
        mem_mb=8000,
        gpu=PLAN.gpus,
    params:
        condition=lambda wildcards: condition(wildcards.on),
    shell:
        command("evaluate")
        + "{params.condition} io.packed={input.packed:q} io.split={input.split:q} io.lights={input.lights:q} "
        + "io.network={input.network:q} io.out={output:q}"
        + LOGGED_TRAINING


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
