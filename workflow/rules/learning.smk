rule train:
    input:
        cfg=settings("train.{run}"),
        packed=f"{OUT}/packed.safetensors",
        split=f"{OUT}/split.json",
        lights=f"{OUT}/lights/lights.npz",
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
        + "io.packed={input.packed} io.split={input.split} io.lights={input.lights} "
        + "io.out={output.network} io.curve={output.curve}"
        + LOGGED_RUN


rule evaluate:
    input:
        cfg=settings("evaluate"),
        packed=f"{OUT}/packed.safetensors",
        split=f"{OUT}/split.json",
        lights=f"{OUT}/lights/lights.npz",
        network=f"{OUT}/train/{{run}}.safetensors",
    output:
        scores=f"{OUT}/evaluate/{{run}}.csv",
        plate=f"{OUT}/evaluate/{{run}}.png",
    log:
        f"{OUT}/log/evaluate/{{run}}.log",
    resources:
        mem_mb=8000,
        gpu=PLAN.gpus,
    shell:
        command("evaluate")
        + "io.packed={input.packed} io.split={input.split} io.lights={input.lights} "
        + "io.network={input.network} io.out={output.scores} io.plate={output.plate}"
        + LOGGED_RUN


rule baselines:
    input:
        cfg=settings("baselines"),
        packed=f"{OUT}/packed.safetensors",
        split=f"{OUT}/split.json",
        lights=f"{OUT}/lights/lights.npz",
    output:
        f"{OUT}/evaluate/baselines.csv",
    log:
        f"{OUT}/log/baselines.log",
    resources:
        mem_mb=8000,
    shell:
        command("baselines")
        + "io.packed={input.packed} io.split={input.split} io.lights={input.lights} io.out={output}"
        + LOGGED
