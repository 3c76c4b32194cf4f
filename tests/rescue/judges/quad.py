import sys,math,collections
# believed heading against the true one at each search, modulo first median; prints runs with jumps over 45 degrees
true={};B=collections.OrderedDict()
for l in open(sys.argv[1]):
    w=l.split()
    if not w: continue
    if w[0]=='P': true[w[1]]=tuple(map(float,w[3:6]))
    elif w[0]=='E' and w[3]=='Log' and ' B ' in l:
        i=w.index('B');b=tuple(map(float,w[i+1:i+4]));B.setdefault(w[1],[]).append((b,true[w[1]],float(w[2])))
for k,v in B.items():
    o=[((b[2]-t[2])*57.3)%360 for b,t,_ in v]
    d=[round((x-o[0]+180)%360-180) for x in o]
    if any(abs(d[i]-d[i-1])>40 for i in range(1,len(d))): print(k[-6:],d)
