rule split:
    "Divides the figures into training, validation and test."
    input:
        packed=PACKED,
        record=f"{DATA}/figures.json",
    output:
        SPLIT,
    log:
        f"{OUT}/log/split.log",
    benchmark:
        f"{OUT}/benchmark/split/all.tsv"
    localrule: True
    params:
        split={key: value for key, value in SETTINGS["split"].items() if key != "least"},
        code=code_hash("split"),
    script:
        "../scripts/split.py"


rule train:
    "Trains one network, or resumes its training."
    input:
        packed=PACKED,
        lights=LIGHTS,
        split=SPLIT,
        start=lambda wildcards: PLAN.settings(wildcards.training)["train"]["start"]
        or [],
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
        device=lambda wildcards: PLAN.device(wildcards.training),
    params:
        settings=lambda wildcards: PLAN.settings(wildcards.training)
        | PLAN.start_stamps(wildcards.training),
        code=lambda wildcards: code_hash("train", PLAN.extensions(wildcards.training)),
    script:
        "../scripts/train.py"


rule evaluate:
    "Scores one network on every test figure under every test light."
    input:
        f"{OUT}/train/{{training}}.safetensors",
        PACKED,
        LIGHTS,
        SPLIT,
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
        scored=SCORED,
        code=lambda wildcards: code_hash(
            "evaluate", PLAN.extensions(wildcards.training)
        ),
    script:
        "../scripts/evaluate.py"


rule baselines:
    "Scores what needs no network, such as the mean of the training set."
    input:
        PACKED,
        LIGHTS,
        SPLIT,
    output:
        f"{OUT}/evaluate/{{on}}baselines.csv",
    log:
        f"{OUT}/log/evaluate/{{on}}baselines.log",
    benchmark:
        f"{OUT}/benchmark/baselines/{{on}}all.tsv"
    resources:
        mem_mb=8000,
    params:
        color=SETTINGS["train"]["color"],
        order=SETTINGS["bake"]["order"],
        scored=SCORED,
        code=code_hash("baselines"),
    script:
        "../scripts/baselines.py"
