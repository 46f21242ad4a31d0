"""What a made-up certificate says beside the results."""

ABOUT = """\
number = "V-2026-042"
issued = 2026-11-05
received = 2026-11-02
place = "laboratory"

[item]
name = "articulated arm coordinate measuring machine"
maker = "Example Arms"
model = "A 2500"
serial_number = "10017"

[laboratory]
name = "Example Laboratory"
code = "X-000-00"
street = "Gauge Street"
street_no = "1"
post_code = "00000"
city = "Exampletown"
country = "DE"

[customer]
name = "Example Customer"
post_code = "00001"
city = "Exampleville"
country = "FR"

[[persons]]
name = "First Example"
role = "head of the laboratory"
main_signer = true

[[persons]]
name = "Second Example"

[conditions]
temperature_degC = [19.6, 20.4]
relative_humidity_percent = [40.0, 55.0]
"""
