# durations of searches by outcome; cancels with distance to station
import sys,re,math,collections
for fn in sys.argv[1:]:
    P=collections.defaultdict(list);D=collections.defaultdict(list);S={};home={}
    for l in open(fn):
        w=l.split()
        if not w: continue
        if w[0]=='Y':
            S[w[1]]=tuple(map(float,re.search(r'Station \{ at: Spot\(\[Coordinate\(([-\d.]+)\), Coordinate\(([-\d.]+)\)\]\), heading_degrees: ([-\d.]+)',l).groups()))
        elif w[0]=='P': P[w[1]]=(float(w[2]),float(w[3]),float(w[4]),float(w[6]))
        elif w[0]=='E' and w[3] in('Heard','Said') and 'Engine' in l: D[w[1]].append((float(w[2]),w[3],' '.join(w[4:]),P[w[1]]))
    L=[];C=[]
    for k,v in D.items():
        t0=None
        for t,who,what,p in v:
            if 'Engine(Dock)' in what and who=='Heard': t0=t;n=p
            elif t0 and ('CancelDock' in what or 'BaseNotFound' in what or 'Docked' in what or 'BaseFound' in what):
                d=math.hypot(p[1]-S[k][0],p[2]-S[k][1]);L.append((what.replace('Engine(','').strip(')'),round(t-t0),round(d,2),k[-6:],round(t)));t0=None
    c=collections.Counter(x[0] for x in L);print(fn,dict(c))
    print('  long notfound (>60 s):',[x[1:] for x in L if 'NotFound' in x[0] and x[1]>60])
    print('  cancels:',[x[1:] for x in L if 'Cancel' in x[0]])
