import canopen

network = canopen.Network()
network.connect(interface="socketcand", host="127.0.0.1", port=29536, channel="plumb")
node = network.add_node(1, "eds/plumb-a.eds")
while node.sdo[0x2020].raw & 3 != 3:  # both slopes are valid once the filters have settled
    pass
x, y = (node.sdo[index].raw * node.sdo[0x6000].raw / 1000 for index in (0x6110, 0x6120))
print(f"slope X {x:.2f} deg, slope Y {y:.2f} deg")
network.disconnect()
